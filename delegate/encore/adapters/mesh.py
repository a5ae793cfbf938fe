"""UsdGeom.Mesh → the arrays that core takes, without a copy where USD's own layout allows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom

from encore.adapters.context import Matrix, SyncContext
from encore.adapters.motion import normal_motion, point_motion
from encore.adapters.primvars import (
    TARGET_EDGE_LENGTH,
    THIN_WALLED,
    ElementCounts,
    FloatArray,
    IntArray,
    Primvar,
    Wanted,
    is_texcoord,
    make_primvar,
    read_bool,
    read_number,
    read_primvar,
    read_wanted,
    reject,
    report_missing,
)
from encore.adapters.shading_rate import NO_RATES, Rates, read_rates

_NO_INTS: IntArray = np.empty(0, np.int32)
_NO_FLOATS: FloatArray = np.empty(0, np.float32)
# Odd, without a pattern: fractions of the golden ratio and of the roots of 2 and 3, times 2^64.
_HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0x6A09E667F3BCC909, 0xBB67AE8584CAA73B], np.uint64)


@dataclass
class MeshData:
    """One mesh as _core.Scene.add_mesh takes it, without materials. points: (n, 3), in its own space.

    primvars: four floats wide. motion_points and motion_normals: (keys, n, 3), points and values of normals
    at uniform times over the shutter; None: they stay. Arrays may be views of USD's and are not to be
    written to.
    """

    path: str
    points: FloatArray
    face_vertex_counts: IntArray
    face_vertex_indices: IntArray
    scheme: str = "none"
    interpolate_boundary: str = "edgeAndCorner"
    face_varying: str = "cornersPlus1"
    triangle_subdivision: str = "catmullClark"
    left_handed: bool = False
    double_sided: bool = False
    hole_indices: IntArray = field(default_factory=lambda: _NO_INTS)
    corner_indices: IntArray = field(default_factory=lambda: _NO_INTS)
    corner_sharpnesses: FloatArray = field(default_factory=lambda: _NO_FLOATS)
    crease_indices: IntArray = field(default_factory=lambda: _NO_INTS)
    crease_lengths: IntArray = field(default_factory=lambda: _NO_INTS)
    crease_sharpnesses: FloatArray = field(default_factory=lambda: _NO_FLOATS)
    normals: Primvar | None = None
    display_color: Primvar | None = None
    texcoords: Mapping[str, Primvar] = field(default_factory=dict)
    primvars: Mapping[str, Primvar] = field(default_factory=dict)
    target_edge_length_world: float = 0.0
    shading_rate: Rates = NO_RATES
    thin_walled: bool = False
    link_group: int = 0
    motion_points: FloatArray | None = None
    motion_normals: FloatArray | None = None

    @property
    def face_count(self) -> int:
        return len(self.face_vertex_counts)

    def without(self, cut: npt.NDArray[np.bool_]) -> MeshData:
        """The same mesh without the faces where `cut` is true.

        Holes where there is a scheme, so that the rest keeps its shape; polygons, without holes, lose faces.
        """
        if self.scheme != "none":
            holes = np.union1d(self.hole_indices, np.flatnonzero(cut)).astype(np.int32)
            return replace(self, hole_indices=holes)
        kept = {"uniform": ~cut, "faceVarying": np.repeat(~cut, self.face_vertex_counts)}
        return replace(
            self,
            face_vertex_counts=self.face_vertex_counts[kept["uniform"]],
            face_vertex_indices=self.face_vertex_indices[kept["faceVarying"]],
            normals=_kept(self.normals, kept),
            motion_normals=self._kept_motion(kept),
            display_color=_kept(self.display_color, kept),
            texcoords={name: primvar.kept(kept) for name, primvar in self.texcoords.items()},
            primvars={name: primvar.kept(kept) for name, primvar in self.primvars.items()},
        )

    def _kept_motion(self, kept: Mapping[str, npt.NDArray[np.bool_]]) -> FloatArray | None:
        """motion_normals of the normals that Primvar.kept() keeps."""
        if self.motion_normals is None or self.normals is None or self.normals.indices is not None:
            return self.motion_normals
        keep = kept.get(self.normals.interpolation)
        return self.motion_normals if keep is None else np.ascontiguousarray(self.motion_normals[:, keep])

    def transformed(self, matrix: Matrix) -> MeshData:
        """The same mesh in another space. A mirroring transform turns the orientation round."""
        linear, translation = matrix[:3, :3], matrix[3, :3]
        determinant = np.linalg.det(linear)
        to_normals = np.linalg.inv(linear).T if determinant != 0 else None
        normals = self.normals
        if normals is not None and to_normals is not None:
            normals = normals._replace(values=_transformed(normals.values, to_normals))
        motion_points, motion_normals = self.motion_points, self.motion_normals
        if motion_points is not None:
            motion_points = _transformed(motion_points, linear, translation)
        if motion_normals is not None and to_normals is not None:
            motion_normals = _transformed(motion_normals, to_normals)
        return replace(
            self,
            points=_transformed(self.points, linear, translation),
            normals=normals,
            motion_points=motion_points,
            motion_normals=motion_normals,
            left_handed=self.left_handed != bool(determinant < 0),
        )

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of _core.Scene.add_mesh."""
        lists = {
            "texcoords": [(name, *primvar) for name, primvar in self.texcoords.items()],
            "primvars": [(name, *primvar) for name, primvar in self.primvars.items()],
        }
        return vars(self) | lists


def read_mesh(
    mesh: UsdGeom.Mesh,
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    context: SyncContext,
) -> MeshData | None:
    """The mesh at the context's time, or None (and a report) where it has no faces.

    primvars: by name, inherited ones included.
    """
    path = mesh.GetPath()
    get = _reader(mesh.GetPrim(), context)
    points, face_counts, face_indices = get("points"), get("faceVertexCounts"), get("faceVertexIndices")
    if not points or not face_counts or not face_indices:
        context.reports.add("empty mesh", "has no points or no faces, and is not rendered", path)
        return None
    counts = ElementCounts(len(face_counts), len(points), len(face_indices))
    data = MeshData(
        path=str(path),
        points=_array(points, np.float32),
        face_vertex_counts=_array(face_counts, np.int32),
        face_vertex_indices=_array(face_indices, np.int32),
        scheme=str(get("subdivisionScheme") or UsdGeom.Tokens.catmullClark),
        left_handed=get("orientation") == UsdGeom.Tokens.leftHanded,
        double_sided=bool(get("doubleSided")),
        display_color=read_color(primvars, counts, path, context) if wanted.color else None,
        texcoords=read_texcoords(primvars, wanted, counts, path, context),
        primvars=read_wanted(primvars, wanted, counts, path, context),
        target_edge_length_world=read_edge_length(primvars, path, context),
        shading_rate=read_rates(primvars, context),
    )
    if data.scheme == UsdGeom.Tokens.none:
        data.normals = _read_normals(mesh, get("normals"), primvars, counts, context)
    else:
        _read_subdivision(data, get)
    _read_motion(data, mesh, context)
    if wanted.solidity:
        thin = read_bool(primvars, THIN_WALLED, path, context)
        data.thin_walled = not is_closed(data) if thin is None else thin
    return data


def is_closed(data: MeshData) -> bool:
    """Whether the mesh is the skin of a solid: each of its edges belongs to an even number of faces.

    Points at the same place count as one; faces that are holes do not count.
    """
    counts, indices = data.face_vertex_counts, data.face_vertex_indices
    if counts.min() < 3 or counts.sum() != len(indices):
        return False
    if indices.min() < 0 or indices.max() >= len(data.points):
        return False  # core says what is wrong
    if _edges_are_even(data, indices):
        return True
    return _edges_are_even(data, _places(data.points)[indices])


def _places(points: FloatArray) -> npt.NDArray[np.int64]:
    """A number per point, the same for points at the same place.

    By hashes of 64 bits, which are far faster to sort than points: of a million places, two get the same
    number with a chance below 1e-7.
    """
    bits = np.ascontiguousarray(points + np.float32(0)).view(np.uint32).astype(np.uint64)  # -0 becomes 0
    hashes = (bits * _HASH_FACTORS).sum(axis=1, dtype=np.uint64)
    _, places = np.unique(hashes, return_inverse=True)
    return np.asarray(places, np.int64).ravel()


def _edges_are_even(data: MeshData, corners: npt.NDArray[np.integer[Any]]) -> bool:
    """corners: which point each face corner is."""
    counts = data.face_vertex_counts.astype(np.int64)
    ends = np.cumsum(counts)
    following = np.arange(1, len(corners) + 1)
    following[ends - 1] = ends - counts
    a, b = corners.astype(np.int64), corners[following].astype(np.int64)
    used = a != b
    if data.hole_indices.size:
        seen = np.ones(len(counts), bool)
        seen[data.hole_indices[(data.hole_indices >= 0) & (data.hole_indices < len(counts))]] = False
        used &= np.repeat(seen, counts)
    edges = np.minimum(a, b)[used] << 32 | np.maximum(a, b)[used]
    _, uses = np.unique(edges, return_counts=True)
    return bool(uses.size and (uses % 2 == 0).all())


def _read_motion(data: MeshData, mesh: UsdGeom.Mesh, context: SyncContext) -> None:
    """Points and normals over the shutter, where they fit those of the frame's time."""
    points = point_motion(mesh.GetPrim(), context)
    if points is None:
        return
    if points.ndim != 3 or points.shape[1:] != data.points.shape:
        context.reports.error(
            "bad motion",
            "the number of its points changes while the shutter is open: it stays",
            mesh.GetPath(),
        )
        return
    data.motion_points = points
    if data.normals is not None:
        normals = normal_motion(mesh.GetPrim(), context, len(points))
        if normals is not None and normals.shape == (len(points), *data.normals.values.shape):
            data.motion_normals = normals


def read_texcoords(
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    counts: ElementCounts,
    path: Sdf.Path,
    context: SyncContext,
) -> dict[str, Primvar]:
    """The texture coordinates that are wanted, as far as they exist; what is missing is reported."""
    texcoords = {}
    for name in sorted(wanted.texcoords):
        primvar = primvars.get(name)
        if primvar is None:
            if name not in wanted.optional:
                report_missing(name, "texture coordinates", path, context)
            continue
        if not is_texcoord(primvar):
            reject(name, path, context, f"it has type {primvar.GetTypeName()}, not two floats per element")
            continue
        read = read_primvar(primvar, 2, counts, path, context)
        if read is not None:
            texcoords[name] = read
    return texcoords


def read_color(
    primvars: Mapping[str, UsdGeom.Primvar], counts: ElementCounts, path: Sdf.Path, context: SyncContext
) -> Primvar | None:
    """displayColor, where there is one that can be used."""
    primvar = primvars.get("displayColor")
    return read_primvar(primvar, 3, counts, path, context) if primvar is not None else None


def read_edge_length(primvars: Mapping[str, UsdGeom.Primvar], path: Sdf.Path, context: SyncContext) -> float:
    """World-space edge length: the prim's own or inherited one; 0: the frame's."""
    return read_number(primvars, TARGET_EDGE_LENGTH, path, context) or 0.0


def _reader(prim: Usd.Prim, context: SyncContext) -> Callable[[str], Any]:
    """Reads attributes at the context's time; None, without asking USD, for one that is not authored."""
    authored = frozenset(prim.GetAuthoredPropertyNames())
    return lambda name: prim.GetAttribute(name).Get(context.time) if name in authored else None


def _read_normals(
    mesh: UsdGeom.Mesh,
    value: Any,
    primvars: Mapping[str, UsdGeom.Primvar],
    counts: ElementCounts,
    context: SyncContext,
) -> Primvar | None:
    """primvars:normals before normals (value), as UsdGeomPointBased says."""
    if "normals" in primvars:
        return read_primvar(primvars["normals"], 3, counts, mesh.GetPath(), context)
    if not value:
        return None
    interpolation = mesh.GetNormalsInterpolation()
    return make_primvar("normals", interpolation, value, None, 3, counts, mesh.GetPath(), context)


def _read_subdivision(data: MeshData, get: Callable[[str], Any]) -> None:
    """Rules, holes and sharp features; what is not authored keeps UsdGeomMesh's fallback."""
    data.interpolate_boundary = str(get("interpolateBoundary") or data.interpolate_boundary)
    data.face_varying = str(get("faceVaryingLinearInterpolation") or data.face_varying)
    data.triangle_subdivision = str(get("triangleSubdivisionRule") or data.triangle_subdivision)
    data.hole_indices = _array(get("holeIndices"), np.int32)
    corners, creases = get("cornerIndices"), get("creaseIndices")
    if corners:
        data.corner_indices = _array(corners, np.int32)
        data.corner_sharpnesses = _array(get("cornerSharpnesses"), np.float32)
    if creases:
        data.crease_indices = _array(creases, np.int32)
        data.crease_lengths = _array(get("creaseLengths"), np.int32)
        data.crease_sharpnesses = _array(get("creaseSharpnesses"), np.float32)


def _kept(primvar: Primvar | None, kept: Mapping[str, npt.NDArray[np.bool_]]) -> Primvar | None:
    return None if primvar is None else primvar.kept(kept)


def _transformed(
    vectors: FloatArray,
    linear: npt.NDArray[np.floating[Any]],
    translation: npt.NDArray[np.float64] | None = None,
) -> FloatArray:
    moved = vectors.astype(np.float64) @ linear
    return np.ascontiguousarray(moved if translation is None else moved + translation, np.float32)


def _array(value: Any, dtype: type) -> npt.NDArray[Any]:
    """A view of a VtArray."""
    return np.asarray(value if value is not None else (), dtype=dtype)
