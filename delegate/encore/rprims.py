"""Meshes and implicit shapes with their materials: from prims to what core places."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Sdf, UsdGeom, UsdShade

from encore.adapters import implicit
from encore.adapters.context import Matrix, SyncContext
from encore.adapters.material import MaterialData
from encore.adapters.mesh import MeshData, read_color, read_mesh, read_texcoords
from encore.adapters.primvars import (
    THIN_WALLED,
    ElementCounts,
    IntArray,
    Wanted,
    four_wide,
    read_bool,
    read_wanted,
)
from encore.adapters.shading_rate import read_rates
from encore.population import Rprim
from encore.render_delegate import BoundMaterial, RenderDelegate

# Prim path → its resolved material; None where nothing that is supported is bound.
Bound = Mapping[Sdf.Path, BoundMaterial | None]

_IDENTITY: Matrix = np.eye(4)


@dataclass(frozen=True)
class SyncedRprim:
    """A mesh in its own space, with its materials. matrix: from that space to the group's.

    share_key: equal for rprims with the same geometry, which differ in material, shading rate and place only;
    None: shared with none. face_materials: per face, -1 for material.
    """

    data: MeshData
    matrix: Matrix
    material: BoundMaterial
    face_materials: IntArray | None = None
    share_key: Any = None


class RprimReader:
    """Reads rprims. bound: materials of rprims and subsets, empty where all is inherited from instances."""

    def __init__(self, delegate: RenderDelegate, bound: Bound, context: SyncContext) -> None:
        self._delegate = delegate
        self._bound = bound
        self._context = context

    def read(
        self, rprim: Rprim, uniform: bool, overrides: Collection[BoundMaterial | None]
    ) -> SyncedRprim | None:
        """The rprim; None where nothing of it is visible (broken ones are reported).

        uniform: no material is bound inside of its group. overrides: materials of the places where it will
        be, None for its own.
        """
        prim = rprim.prim
        own = None if uniform else self._bound.get(prim.GetPath())
        subsets = {} if uniform else self._subset_materials(rprim)
        # Its own colour is needed where it has no material.
        colored = own is None and (None in overrides or not overrides)
        materials = [m.data for m in (own, *subsets.values(), *overrides) if m is not None]
        reads_color = any(m.reads_color for m in materials)
        wanted = _wanted(materials, colored or reads_color)
        found = UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance(rprim.inherited)
        primvars = {str(p.GetPrimvarName()): p for p in found}
        self._report_unsupported(rprim, primvars, colored)
        if prim.IsA(UsdGeom.Mesh):
            matrix, key = rprim.matrix, None
            data = read_mesh(UsdGeom.Mesh(prim), primvars, wanted, self._context)
        else:
            shape = self._read_implicit(rprim, primvars, wanted)
            if shape is None:
                return None
            data, matrix, key = shape
        if data is None:
            return None
        material = own or (
            self._delegate.fallback_material(data.display_color)
            if colored
            else self._delegate.default_material
        )
        displaced = self._displacing(rprim, own, overrides)
        if displaced is not None:
            material, key = displaced, None
        if not (reads_color or material.data.reads_color):
            data.display_color = None
        elif data.display_color is not None:
            key = None
        return self._with_subsets(SyncedRprim(data, matrix, material, share_key=key), subsets)

    def _displacing(
        self, rprim: Rprim, own: BoundMaterial | None, overrides: Collection[BoundMaterial | None]
    ) -> BoundMaterial | None:
        """The material that displaces the mesh, if there is one: core takes it from the mesh itself.

        Instances that inherit different ones share one mesh, and so one displacement, which is reported.
        """
        if own is not None:
            return own if own.data.displaces else None
        found = [m for m in overrides if m is not None and m.data.displaces]
        if found and any(m is not found[0] for m in overrides):
            self._context.reports.add(
                "displacement of instances",
                f"its instances have several materials: all are displaced as {found[0].data.path} says",
                rprim.prim.GetPath(),
            )
        return found[0] if found else None

    def _read_implicit(
        self, rprim: Rprim, primvars: Mapping[str, UsdGeom.Primvar], wanted: Wanted
    ) -> tuple[MeshData, Matrix, Any] | None:
        """The mesh of an implicit shape, its matrix to the group, and its key for sharing."""
        prim, context = rprim.prim, self._context
        shape = implicit.shape_of(prim, context)
        if shape is None:
            return None
        path = prim.GetPath()
        data = implicit.build(*shape.key)
        left_handed, double_sided = implicit.orientation(prim, context)
        counts = ElementCounts(data.face_count, len(data.points), len(data.face_vertex_indices))
        constants = {n: p for n, p in primvars.items() if p.GetInterpolation() == UsdGeom.Tokens.constant}
        own = frozenset(data.texcoords) - constants.keys()
        texcoords = {name: data.texcoords[name] for name in own & wanted.texcoords}
        texcoords |= read_texcoords(
            constants, replace(wanted, texcoords=wanted.texcoords - own), counts, path, context
        )
        others = {name: width for name, width in wanted.primvars.items() if name not in own}
        read = read_wanted(constants, replace(wanted, primvars=others), counts, path, context)
        read |= {name: four_wide(data.texcoords[name]) for name in own & wanted.primvars.keys()}
        normals = data.normals
        if left_handed and normals is not None:
            normals = normals._replace(values=-normals.values)
        thin = read_bool(primvars, THIN_WALLED, path, context)
        thin = not implicit.is_solid(shape) if thin is None else thin
        key = (shape.key, left_handed, double_sided, thin, tuple(sorted(own & wanted.texcoords)))
        data = replace(
            data,
            path=str(path),
            left_handed=left_handed,
            double_sided=double_sided,
            normals=normals,
            texcoords=texcoords,
            primvars=read,
            thin_walled=thin,
            shading_rate=read_rates(primvars, context),
            display_color=read_color(constants, counts, path, context) if wanted.color else None,
        )
        shares = not read and texcoords.keys() <= own
        return data, shape.to_prim @ rprim.matrix, key if shares else None

    def _subset_materials(self, rprim: Rprim) -> dict[Sdf.Path, BoundMaterial]:
        """Materials of the GeomSubsets of family materialBind, by the subset's path."""
        found = {}
        for subset in rprim.subsets:
            if subset.GetFamilyNameAttr().Get() != UsdShade.Tokens.materialBind:
                continue
            if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
                self._context.reports.add(
                    "subset of points",
                    "materials can only be bound to subsets of faces: it is ignored",
                    subset.GetPath(),
                )
                continue
            material = self._bound.get(subset.GetPath())
            if material is not None:
                found[subset.GetPath()] = material
        return found

    def _with_subsets(
        self, synced: SyncedRprim, subsets: Mapping[Sdf.Path, BoundMaterial]
    ) -> SyncedRprim | None:
        """Gives subsets their materials and takes away the faces whose material cuts them out."""
        if not subsets:
            return None if synced.material.data.cut_out else synced
        faces = synced.data.face_count
        cut = np.full(faces, synced.material.data.cut_out)
        face_materials = np.full(faces, -1, np.int32)
        for path, material in subsets.items():
            indices = self._subset_faces(path, faces)
            face_materials[indices] = material.index
            cut[indices] = material.data.cut_out
        data = synced.data
        if cut.all():
            return None
        if cut.any():
            data = data.without(cut)
            if data.face_count < faces:
                face_materials = face_materials[~cut]
        return replace(synced, data=data, face_materials=face_materials, share_key=None)

    def _subset_faces(self, path: Sdf.Path, faces: int) -> IntArray:
        subset = UsdGeom.Subset(self._context.stage.GetPrimAtPath(path))
        indices = np.asarray(subset.GetIndicesAttr().Get(self._context.time) or (), dtype=np.int32)
        valid = (indices >= 0) & (indices < faces)
        if not valid.all():
            self._context.reports.error(
                "bad subset", f"{np.count_nonzero(~valid)} of its indices are out of range: ignored", path
            )
        return indices[valid]

    def _report_unsupported(
        self, rprim: Rprim, primvars: Mapping[str, UsdGeom.Primvar], colored: bool
    ) -> None:
        path, reports = rprim.prim.GetPath(), self._context.reports
        if "skel:jointIndices" in primvars:
            reports.add("skinning", "UsdSkel is not supported yet: it is rendered without skinning", path)
        if colored and "displayOpacity" in primvars:
            value = primvars["displayOpacity"].Get(self._context.time)
            if value is not None and np.min(np.asarray(value, dtype=np.float32), initial=1.0) < 1:
                reports.add("displayOpacity", "displayOpacity is not supported yet: it is opaque", path)


def _wanted(materials: Collection[MaterialData], color: bool) -> Wanted:
    """What all of the materials together read of a mesh."""
    primvars: dict[str, int] = {}
    needed: set[str] = set()
    for material in materials:
        for name, width in material.primvars.items():
            primvars[name] = max(width, primvars.get(name, 0))
        needed |= (material.texcoords | material.primvars.keys()) - material.optional
    texcoords = frozenset().union(*(m.texcoords for m in materials))
    optional = (texcoords | primvars.keys()) - needed
    return Wanted(texcoords, primvars, optional, color, any(m.transmits for m in materials))
