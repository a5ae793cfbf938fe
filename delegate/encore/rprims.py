"""Rprims with their materials: from prims to what core places, read where that is not known yet."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from pxr import Sdf, UsdGeom, UsdShade

from encore.adapters.context import BadValueError, SyncContext, array_of
from encore.adapters.instance_primvars import COLOR, OPACITY
from encore.adapters.material import MaterialData
from encore.adapters.mesh import MeshData
from encore.adapters.primvars import IntArray, reject
from encore.groups import Rprim
from encore.materials import BoundMaterial, Materials
from encore.readers import Geometry, Request, reader_of
from encore.rprim_cache import NO_NAMES, Entry, RprimCache, SyncedRprim
from encore.scene_builder import PreparedMesh

# Prim path → its resolved material; None where nothing that is supported is bound.
Bound = Mapping[Sdf.Path, BoundMaterial | None]
_NOTHING_GIVEN: Mapping[str, int] = MappingProxyType({})
_NO_SUBSETS: Mapping[Sdf.Path, BoundMaterial] = MappingProxyType({})


class RprimReader:
    """Reads rprims. bound: materials of rprims and subsets, empty where all is inherited from instances."""

    def __init__(self, cache: RprimCache, materials: Materials, bound: Bound, context: SyncContext) -> None:
        self._cache = cache
        self._materials = materials
        self._bound = bound
        self._context = context

    def read(
        self,
        rprim: Rprim,
        group: Any,
        uniform: bool,
        overrides: tuple[BoundMaterial | None, ...],
        given: Mapping[str, int] = _NOTHING_GIVEN,
    ) -> SyncedRprim | None:
        """The rprim; None where nothing of it is visible (broken ones are reported).

        group: the key of its group. uniform: no material is bound inside of that. overrides: materials of the
        places where it will be, None for its own, each once. given: floats of the primvars that instances
        give it at some of the places.
        """
        own: BoundMaterial | None = None
        of_subsets: tuple[BoundMaterial | None, ...] = ()
        if not uniform:
            own = self._bound.get(rprim.path)
            if rprim.subsets:
                of_subsets = tuple(self._bound.get(s.GetPath()) for s in rprim.subsets)
        entry = self._cache.entry(rprim, group)
        inputs = (own, of_subsets, overrides, given, self._cache.aov_primvars)
        if entry.inputs == inputs:
            if entry.log:
                self._context.reports.replay(entry.log)
            return entry.result
        mark = self._context.reports.mark
        subsets = self._subsets(rprim) if of_subsets else _NO_SUBSETS
        entry.result = self._read(rprim, entry, own, subsets, overrides, given)
        entry.inputs, entry.log = inputs, self._context.reports.since(mark)
        return entry.result

    def _read(
        self,
        rprim: Rprim,
        entry: Entry,
        own: BoundMaterial | None,
        subsets: Mapping[Sdf.Path, BoundMaterial],
        overrides: tuple[BoundMaterial | None, ...],
        given: Mapping[str, int],
    ) -> SyncedRprim | None:
        # Its own colour is needed where it has no material.
        colored = own is None and (None in overrides or not overrides)
        materials = tuple([m for m in (own, *subsets.values(), *overrides) if m is not None])
        reads_color = any(m.data.reads_color for m in materials)
        geometry = self._geometry(rprim, entry, materials, colored, reads_color, given)
        if geometry is None:
            return None
        data, key = geometry.data, geometry.share_key
        material, drops_opacity = own or self._materials.default, False
        if colored:
            read_opacity = any(OPACITY in m.data.primvars for m in materials)
            material = self._fallback(data, given)
            drops_opacity = OPACITY not in material.data.primvars and not read_opacity
            drops_opacity = drops_opacity and OPACITY not in self._cache.aov_primvars
        displaced = self._displacing(rprim, own, overrides)
        if displaced is not None and data.shape != "faces":
            self._context.reports.add(
                f"displacement of {data.shape}",
                f"{data.shape} are not displaced: they stay as they are",
                rprim.path,
            )
        elif displaced is not None:
            material, key = displaced, None
        drops_color = not (reads_color or material.data.reads_color or COLOR in self._cache.aov_primvars)
        if not drops_color and data.display_color is not None:
            key = None
        reads = NO_NAMES
        if given:
            reads = self._reads(rprim, [*(m.data for m in materials), material.data], given)
        mesh = _without(entry, data, drops_color, drops_opacity)
        synced = SyncedRprim(mesh, geometry.to_prim, material, None, (), key, reads)
        return self._with_subsets(entry, synced, subsets)

    def _geometry(
        self,
        rprim: Rprim,
        entry: Entry,
        materials: tuple[BoundMaterial, ...],
        colored: bool,
        reads_color: bool,
        given: Mapping[str, int],
    ) -> Geometry | None:
        """What is known of it, where that has all that is wanted and nothing else; or what is read now."""
        primvars = self._cache.primvars(rprim)
        fades = colored and OPACITY in primvars
        wanted = self._cache.wanted(materials, colored or reads_color, fades, given)
        reports = self._context.reports
        if entry.wanted is wanted or entry.wanted == wanted:
            reports.replay(entry.geometry_log)
            return entry.geometry
        self._cache.read += 1
        mark = reports.mark
        reader = reader_of(rprim.prim, rprim.type_name)
        assert reader is not None, f"{rprim.type_name} is no rprim"
        request = Request(rprim.prim, rprim.path, rprim.authored, primvars, wanted, self._context)
        entry.geometry = reader(request)
        entry.geometry_log = reports.since(mark)
        entry.wanted = wanted
        entry.meshes = {}
        return entry.geometry

    def _fallback(self, data: MeshData, given: Mapping[str, int]) -> BoundMaterial:
        """For what has no material: what displayColor and displayOpacity, its own or its instances', say."""
        opacity = data.primvars.get(OPACITY)
        if opacity is not None and OPACITY not in given and (opacity.values[:, 0] >= 1).all():
            opacity = None
        return self._materials.fallback(data.display_color, opacity, given)

    def _reads(
        self, rprim: Rprim, materials: Collection[MaterialData], given: Mapping[str, int]
    ) -> frozenset[str]:
        """Names of the primvars that materials read of instances; those of too few floats are reported."""
        needed: dict[str, int] = {}
        for material in materials:
            for name, width in material.reads.items():
                needed[name] = max(width, needed.get(name, 0))
        for name in self._cache.aov_primvars:
            needed.setdefault(name, 1)
        path = rprim.path
        for name in sorted(given.keys() & needed.keys()):
            if given[name] < needed[name]:
                why = f"its material reads {needed[name]} floats per element, instances have {given[name]}"
                reject(name, path, self._context, why)
        for name in sorted(frozenset().union(*(m.displacement_reads for m in materials)) & given.keys()):
            self._context.reports.add(
                "displacement by instance",
                f"its displacement reads {name}, which instances have: they share the mesh, and are "
                "displaced by its own values",
                path,
            )
        return frozenset(name for name, width in given.items() if width >= needed.get(name, 5))

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
                rprim.path,
            )
        return found[0] if found else None

    def _subsets(self, rprim: Rprim) -> dict[Sdf.Path, BoundMaterial]:
        """Materials of the GeomSubsets of family materialBind, by the subset's path."""
        found = {}
        for subset in rprim.subsets:
            if subset.GetFamilyNameAttr().Get() != UsdShade.Tokens.materialBind:
                continue
            element = subset.GetElementTypeAttr().Get()
            if element != UsdGeom.Tokens.face:
                self._context.reports.add(
                    f"subset of {element}s",
                    "materials can only be bound to subsets of faces: it is ignored",
                    subset.GetPath(),
                )
                continue
            material = self._bound.get(subset.GetPath())
            if material is not None:
                found[subset.GetPath()] = material
        return found

    def _with_subsets(
        self, entry: Entry, synced: SyncedRprim, subsets: Mapping[Sdf.Path, BoundMaterial]
    ) -> SyncedRprim | None:
        """Gives subsets their materials and takes away the faces whose material cuts them out."""
        if not subsets:
            return None if synced.material.data.cut_out else synced
        faces = synced.data.face_count
        cut = np.full(faces, synced.material.data.cut_out)
        face_materials = np.full(faces, -1, np.int32)
        of_faces: dict[BoundMaterial, int] = {}
        for path, material in subsets.items():
            indices = self._subset_faces(path, faces)
            face_materials[indices] = of_faces.setdefault(material, len(of_faces))
            cut[indices] = material.data.cut_out
        mesh = synced.mesh
        if cut.all():
            return None
        if cut.any():
            key = id(mesh), cut.tobytes()
            if key not in entry.meshes:
                entry.meshes[key] = PreparedMesh(mesh.data.without(cut))
            mesh = entry.meshes[key]
            if mesh.data.face_count < faces:
                face_materials = face_materials[~cut]
        return replace(
            synced, mesh=mesh, face_materials=face_materials, of_faces=tuple(of_faces), share_key=None
        )

    def _subset_faces(self, path: Sdf.Path, faces: int) -> IntArray:
        subset = UsdGeom.Subset(self._context.stage.GetPrimAtPath(path))
        try:
            indices = array_of("indices", subset.GetIndicesAttr().Get(self._context.time), np.int32)
        except BadValueError as error:
            self._context.reports.error("bad subset", f"is ignored: {error}", path)
            return np.empty(0, np.int32)
        valid = (indices >= 0) & (indices < faces)
        if not valid.all():
            self._context.reports.error(
                "bad subset", f"{np.count_nonzero(~valid)} of its indices are out of range: ignored", path
            )
        return indices[valid]


def _without(entry: Entry, data: MeshData, color: bool, opacity: bool) -> PreparedMesh:
    """The entry's geometry without displayColor, or displayOpacity: always the same mesh."""
    key = color and data.display_color is not None, opacity and OPACITY in data.primvars
    found = entry.meshes.get(key)
    if found is None:
        if key[0]:
            data = data.but(display_color=None)
        if key[1]:
            data = data.but(primvars={n: p for n, p in data.primvars.items() if n != OPACITY})
        found = entry.meshes[key] = PreparedMesh(data)
    return found
