"""UsdGeom.Mesh → the arrays that core takes, without a copy where USD's own layout allows it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom

from encore.adapters.context import Matrix, SyncContext
from encore.adapters.primvars import (
    TARGET_EDGE_LENGTH,
    ElementCounts,
    FloatArray,
    IntArray,
    Primvar,
    is_texcoord,
    make_primvar,
    read_number,
    read_primvar,
)
from encore.adapters.shading_rate import NO_RATES, Rates, read_rates

_NO_INTS: IntArray = np.empty(0, np.int32)
_NO_FLOATS: FloatArray = np.empty(0, np.float32)


@dataclass
class MeshData:
    """One mesh as _core.Scene.add_mesh takes it, without materials. points: (n, 3), in its own space.

    Arrays may be views of USD's and are not to be written to.
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
    target_edge_length_world: float = 0.0
    shading_rate: Rates = NO_RATES

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
            display_color=_kept(self.display_color, kept),
            texcoords={name: primvar.kept(kept) for name, primvar in self.texcoords.items()},
        )

    def transformed(self, matrix: Matrix) -> MeshData:
        """The same mesh in another space. A mirroring transform turns the orientation round."""
        linear, translation = matrix[:3, :3], matrix[3, :3]
        points = (self.points.astype(np.float64) @ linear + translation).astype(np.float32)
        normals = self.normals
        determinant = np.linalg.det(linear)
        if normals is not None and determinant != 0:
            values = normals.values.astype(np.float64) @ np.linalg.inv(linear).T
            normals = normals._replace(values=values.astype(np.float32))
        left_handed = self.left_handed != bool(determinant < 0)
        return replace(self, points=points, normals=normals, left_handed=left_handed)

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of _core.Scene.add_mesh."""
        return vars(self) | {"texcoords": [(name, *primvar) for name, primvar in self.texcoords.items()]}


def read_mesh(
    mesh: UsdGeom.Mesh,
    primvars: Mapping[str, UsdGeom.Primvar],
    texcoord_names: Collection[str],
    with_color: bool,
    context: SyncContext,
) -> MeshData | None:
    """The mesh at the context's time, or None (and a report) where it has no faces.

    primvars: by name, inherited ones included. texcoord_names, with_color: what its materials ask for.
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
        display_color=read_color(primvars, counts, path, context) if with_color else None,
        texcoords=read_texcoords(primvars, texcoord_names, counts, path, context),
        target_edge_length_world=read_edge_length(primvars, path, context),
        shading_rate=read_rates(primvars, context),
    )
    if data.scheme == UsdGeom.Tokens.none:
        data.normals = _read_normals(mesh, get("normals"), primvars, counts, context)
    else:
        _read_subdivision(data, get)
    return data


def read_texcoords(
    primvars: Mapping[str, UsdGeom.Primvar],
    names: Collection[str],
    counts: ElementCounts,
    path: Sdf.Path,
    context: SyncContext,
) -> dict[str, Primvar]:
    """The texture coordinates called `names`, as far as they exist; what is missing is reported."""
    texcoords = {}
    for name in sorted(names):
        primvar = primvars.get(name)
        if primvar is None or not is_texcoord(primvar):
            context.reports.add(
                f"missing primvar {name}",
                f"its material reads texture coordinates {name}, which the mesh does not have",
                path,
            )
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


def _array(value: Any, dtype: type) -> npt.NDArray[Any]:
    """A view of a VtArray."""
    return np.asarray(value if value is not None else (), dtype=dtype)
