"""UsdGeom.Mesh → the arrays that core takes, without a copy where USD's own layout allows it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom

from encore.adapters.context import BadValueError, Matrix, SyncContext, array_of
from encore.adapters.curve_counts import segment_counts
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
from encore.adapters.skin_binding import may_be_skinned, read_skin
from encore.adapters.skinning import pose_geometry

_NO_INTS: IntArray = np.empty(0, np.int32)
_NO_FLOATS: FloatArray = np.empty(0, np.float32)
# Odd, without a pattern: fractions of the golden ratio and of the roots of 2 and 3, times 2^64.
_HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0x6A09E667F3BCC909, 0xBB67AE8584CAA73B], np.uint64)


@dataclass
class MeshData:
    """One mesh, set of curves or of points as _core.Mesh takes it. points: (n, 3), in its own space.

    shape: "faces"; "curves", whose face_vertex_counts are points per curve; "points". widths: of both, (n,).
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
    shape: str = "faces"
    basis: str = "linear"
    wrap: str = "nonperiodic"
    widths: Primvar | None = None

    @property
    def face_count(self) -> int:
        return len(self.points) if self.shape == "points" else len(self.face_vertex_counts)

    def without(self, cut: npt.NDArray[np.bool_]) -> MeshData:
        """The same mesh without the faces where `cut` is true.

        Holes where there is a scheme, so that the rest keeps its shape; polygons, without holes, lose faces.
        """
        if self.scheme != "none":
            holes = np.union1d(self.hole_indices, np.flatnonzero(cut)).astype(np.int32)
            return replace(self, hole_indices=holes)
        if self.shape != "faces":
            return self._without_elements(~cut)
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

    def _without_elements(self, keep: npt.NDArray[np.bool_]) -> MeshData:
        """The same curves or points without those that are not kept."""
        points = keep
        kept = dict.fromkeys(("uniform", "vertex", "varying", "faceVarying"), keep)
        counts = self.face_vertex_counts
        if self.shape == "curves":
            points = np.repeat(keep, counts)
            ends = segment_counts(counts, self.basis, self.wrap) + (self.wrap != "periodic")
            varying = np.repeat(keep, ends)
            kept = {"uniform": keep, "vertex": points, "varying": varying, "faceVarying": varying}
            counts = np.ascontiguousarray(counts[keep])
        motion = self.motion_points
        return replace(
            self,
            points=np.ascontiguousarray(self.points[points]),
            face_vertex_counts=counts,
            widths=_kept(self.widths, kept),
            normals=_kept(self.normals, kept),
            motion_points=None if motion is None else np.ascontiguousarray(motion[:, points]),
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
        """The same mesh in another space. A mirroring transform turns the orientation round.

        Widths of curves and points are scaled by the mean of the axes' scales.
        """
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
            widths=_scaled(self.widths, abs(determinant) ** (1 / 3)),
        )

    def but(self, **changes: Any) -> MeshData:
        """A copy with other values: as dataclasses.replace(), but fast."""
        copy = object.__new__(MeshData)
        copy.__dict__ = {**self.__dict__, **changes}
        return copy

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of _core.Mesh, without those that are at its defaults."""
        own = vars(self)
        given = {n: own[n] for n in _REQUIRED}
        for name, default in _DEFAULTS:
            value = own[name]
            # Few values are not the defaults themselves.
            if value is default:
                continue
            if name in _ARRAYS:
                if value.size:
                    given[name] = value
            elif name in _NAMED:
                if value:
                    given[name] = [(n, *primvar) for n, primvar in value.items()]
            elif default is None or value != default:
                given[name] = value
        return given


# Fields of MeshData by how core takes them. Those of its place in a scene, shading_rate and link_group, are
# left out.
_REQUIRED = ("path", "points", "face_vertex_counts", "face_vertex_indices")
_NAMED = frozenset({"texcoords", "primvars"})
_ARRAYS = frozenset(
    {
        "hole_indices",
        "corner_indices",
        "corner_sharpnesses",
        "crease_indices",
        "crease_lengths",
        "crease_sharpnesses",
    }
)
# What meshes are made from by but(), which is faster than from fields.
_EMPTY = MeshData("", _NO_FLOATS.reshape(0, 3), _NO_INTS, _NO_INTS)
# Core's, by name: those of MeshData, but for the scheme.
_DEFAULTS: tuple[tuple[str, Any], ...] = tuple(
    (name, value)
    for name, value in {**vars(_EMPTY), "scheme": "catmullClark"}.items()
    if name not in (*_REQUIRED, "shading_rate", "link_group")
)


def read_mesh(
    mesh: UsdGeom.Mesh,
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    context: SyncContext,
    authored: Collection[str] | None = None,
) -> MeshData | None:
    """The mesh at the context's time, or None (and a report) where it has no faces.

    primvars: by name, inherited ones included. authored: names of the prim's properties with opinions, where
    they are known.
    """
    prim = mesh.GetPrim()
    authored = frozenset(prim.GetAuthoredPropertyNames()) if authored is None else authored
    return read_mesh_prim(prim, prim.GetPath(), authored, primvars, wanted, context)


def read_mesh_prim(
    prim: Usd.Prim,
    path: Sdf.Path,
    authored: Collection[str],
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    context: SyncContext,
) -> MeshData | None:
    """read_mesh() with what is known of the prim."""
    get = _reader(prim, authored, context)
    try:
        return _read_mesh(prim, path, get, authored, primvars, wanted, context)
    except BadValueError as error:
        context.reports.error("bad mesh", f"is not rendered: {error}", path)
        return None


def _read_mesh(
    prim: Usd.Prim,
    path: Sdf.Path,
    get: Callable[[str], Any],
    authored: Collection[str],
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    context: SyncContext,
) -> MeshData | None:
    """Raises BadValueError where values have types that make no sense."""
    points = array_of("points", get("points"), np.float32, 3)
    face_counts = array_of("faceVertexCounts", get("faceVertexCounts"), np.int32)
    face_indices = array_of("faceVertexIndices", get("faceVertexIndices"), np.int32)
    if not points.size or not face_counts.size or not face_indices.size:
        context.reports.add("empty mesh", "has no points or no faces, and is not rendered", path)
        return None
    counts = ElementCounts(len(face_counts), len(points), len(face_indices))
    data = _EMPTY.but(
        path=str(path),
        points=points,
        face_vertex_counts=face_counts,
        face_vertex_indices=face_indices,
        scheme=str(get("subdivisionScheme") or UsdGeom.Tokens.catmullClark),
        left_handed=get("orientation") == UsdGeom.Tokens.leftHanded,
        double_sided=bool(get("doubleSided")),
        display_color=read_color(primvars, counts, path, context) if wanted.color else None,
        texcoords=read_texcoords(primvars, wanted, counts, path, context) if wanted.texcoords else {},
        primvars=read_wanted(primvars, wanted, counts, path, context) if wanted.primvars else {},
        target_edge_length_world=read_edge_length(primvars, path, context) if primvars else 0.0,
        shading_rate=read_rates(primvars, context) if primvars else NO_RATES,
    )
    if data.scheme == UsdGeom.Tokens.none:
        if "normals" in primvars or "normals" in authored:
            data.normals = read_normals(UsdGeom.Mesh(prim), get("normals"), primvars, counts, context)
    else:
        _read_subdivision(data, get)
    if wanted.solidity:
        thin = read_bool(primvars, THIN_WALLED, path, context)
        data.thin_walled = not is_closed(data) if thin is None else thin
    if context.shutter is not None or may_be_skinned(authored, primvars):
        read_pose(data, UsdGeom.Mesh(prim), authored, primvars, context)
    return data


def read_pose(
    data: MeshData,
    prim: UsdGeom.PointBased,
    authored: Collection[str] | None,
    primvars: Mapping[str, UsdGeom.Primvar],
    context: SyncContext,
) -> None:
    """Points and normals as they are at the frame's time, where skeletons pose them, and over the shutter.

    authored: names of the prim's properties with opinions, where they are known.
    """
    authored = prim.GetPrim().GetAuthoredPropertyNames() if authored is None else authored
    bound = may_be_skinned(authored, primvars)
    skin = read_skin(prim.GetPrim(), len(data.points), context) if bound else None
    if skin is not None:
        pose_geometry(data, prim, skin, context)
    elif context.shutter is not None:
        read_geometry_motion(data, prim, context)


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


def read_geometry_motion(data: MeshData, mesh: UsdGeom.PointBased, context: SyncContext) -> None:
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


def _reader(prim: Usd.Prim, authored: Collection[str], context: SyncContext) -> Callable[[str], Any]:
    """Reads attributes at the context's time; None, without asking USD, for one that is not authored."""
    attribute, time = prim.GetAttribute, context.time
    return lambda name: attribute(name).Get(time) if name in authored else None


def read_normals(
    mesh: UsdGeom.PointBased,
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
    data.hole_indices = array_of("holeIndices", get("holeIndices"), np.int32)
    corners = array_of("cornerIndices", get("cornerIndices"), np.int32)
    creases = array_of("creaseIndices", get("creaseIndices"), np.int32)
    if corners.size:
        data.corner_indices = corners
        data.corner_sharpnesses = array_of("cornerSharpnesses", get("cornerSharpnesses"), np.float32)
    if creases.size:
        data.crease_indices = creases
        data.crease_lengths = array_of("creaseLengths", get("creaseLengths"), np.int32)
        data.crease_sharpnesses = array_of("creaseSharpnesses", get("creaseSharpnesses"), np.float32)


def _kept(primvar: Primvar | None, kept: Mapping[str, npt.NDArray[np.bool_]]) -> Primvar | None:
    return None if primvar is None else primvar.kept(kept)


def _scaled(widths: Primvar | None, scale: float) -> Primvar | None:
    return None if widths is None else widths._replace(values=(widths.values * scale).astype(np.float32))


def _transformed(
    vectors: FloatArray,
    linear: npt.NDArray[np.floating[Any]],
    translation: npt.NDArray[np.float64] | None = None,
) -> FloatArray:
    moved = vectors.astype(np.float64) @ linear
    return np.ascontiguousarray(moved if translation is None else moved + translation, np.float32)
