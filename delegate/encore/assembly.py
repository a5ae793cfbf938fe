"""From what is known of a stage to the scene that core renders: places, materials, lights, in one order."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Sdf, Usd

from encore.adapters import instance_primvars
from encore.adapters.camera import CameraData, frame_stage, read_camera
from encore.adapters.context import Matrix, SyncContext
from encore.adapters.instancer import product, regular_matrices, report_singular
from encore.adapters.light import LightData, camera_light
from encore.adapters.linking import Links
from encore.adapters.matrix_motion import MatrixKeys, compose, moving_instances
from encore.adapters.mesh_light import keeps_material, read_tint
from encore.adapters.primvars import Primvar
from encore.adapters.shading_rate import combine
from encore.errors import StageError
from encore.groups import Group, LightPrim, Rprim
from encore.materials import BoundMaterial
from encore.parts import Parts
from encore.places import Placed, chosen, given_at, materials_of, spread
from encore.report import Severity
from encore.rprim_cache import SyncedRprim
from encore.rprims import RprimReader
from encore.scene_builder import SceneBuilder

if TYPE_CHECKING:
    from encore.render_index import SyncOptions


_AS_BOUND = (None,)  # no other materials than their own
_NOTHING_GIVEN: Mapping[str, int] = MappingProxyType({})


class Assembly:
    """Puts what is known of a stage together to a new scene, always in the same order."""

    def __init__(self, parts: Parts, options: SyncOptions, context: SyncContext) -> None:
        self._parts = parts
        self._options = options
        self._context = context
        self._reports = context.reports
        self._builder = SceneBuilder(parts.materials, parts.textures, context)
        self._bound: dict[Sdf.Path, BoundMaterial | None] = {}
        self._reader = RprimReader(parts.rprims, parts.materials, self._bound, context)
        self._placed: dict[int, list[Placed]] = {}  # by id of the group
        self._shared: dict[Any, int] = {}  # prototypes by SyncedRprim.share_key
        self._links = Links((), context)
        self._mesh_lights: list[tuple[LightData, Usd.Prim]] = []

    def assemble(self) -> tuple[Any, CameraData]:
        """The scene, without its camera, and that."""
        self._bind()
        self._place(self._parts.root, Placed(np.eye(4)[None]))
        self._links = Links(self._light_prims(), self._context)
        for group in self._parts.groups:
            self._sync_rprims(group, self._placed.get(id(group), []))
        self._builder.flush()
        self._require_instances()
        camera = self._camera()
        self._sync_lights(camera)
        return self._builder.scene, camera

    @property
    def _source(self) -> str:
        return str(self._context.stage.GetRootLayer().identifier)

    def _bind(self) -> None:
        """Finds the materials of all prims."""
        materials = self._parts.bindings(self._bindable(), self._reports)
        for path, material in materials.items():
            bound = self._parts.materials.material(material, self._context) if material else None
            self._bound[path] = bound
            if bound is not None:
                self._builder.material(bound)

    def _bindable(self) -> dict[Sdf.Path, Usd.Prim]:
        """What materials may be bound to, in the order of the walk."""
        prims: dict[Sdf.Path, Usd.Prim] = {}
        for group in self._parts.groups:
            for rprim in () if group.uniform else group.rprims:
                prims[rprim.path] = rprim.prim
                for subset in rprim.subsets:
                    prims[subset.GetPath()] = subset.GetPrim()
            prims |= {c.bound.GetPath(): c.bound for c in group.children if c.bound}
        return prims

    def _place(self, group: Group, placed: Placed) -> None:
        """Notes where a group is in the world, and all that is placed in it."""
        self._placed.setdefault(id(group), []).append(placed)
        for child, matrices, regular in spread(group.children, placed.matrices):
            material = placed.material
            if not group.uniform:
                material = self._bound[child.bound.GetPath()] if child.bound else None
            suffix = (
                child.path if group.path.IsAbsoluteRootPath() else child.path.removeprefix(str(group.path))
            )
            if len(placed.matrices) == 1:
                path, ids = placed.path_of(0) + suffix, child.ids
            else:
                path, ids = placed.path + suffix, np.arange(len(matrices), dtype=np.int64)
            rates = combine(placed.rates, child.rates, len(placed.matrices), len(child.matrices))
            motion = compose(child.matrices, child.motion, placed.matrices, placed.motion)
            outer = placed.primvars if child.inherits else instance_primvars.winning(placed.primvars)
            primvars = instance_primvars.combine(
                outer, child.primvars, len(placed.matrices), len(child.matrices)
            )
            if not regular.all():
                report_singular(path, matrices[~regular], self._context)
                matrices, ids = matrices[regular], None if ids is None else ids[regular]
                rates = None if rates is None else rates[regular]
                motion = None if motion is None else motion[regular]
                primvars = instance_primvars.chosen(primvars, regular)
            if len(matrices):
                self._place(child.group, Placed(matrices, path, ids, material, rates, motion, primvars))

    # Rprims

    def _sync_rprims(self, group: Group, places: list[Placed]) -> None:
        """Meshes that are placed alone stay in their own space; those placed together share the group's."""
        places = [p for p in places if p.material is None or not p.material.data.cut_out]
        if not places or not group.rprims:
            return
        regular = regular_matrices(np.stack([r.matrix for r in group.rprims]))
        rprims = [r for r, usable in zip(group.rprims, regular, strict=True) if usable]
        for rprim, usable in zip(group.rprims, regular, strict=True):
            if not usable:
                report_singular(str(rprim.path), rprim.matrix, self._context)
        if group.path.IsAbsoluteRootPath() or len(rprims) == 1:
            alone, together = rprims, []
        else:
            # What moves in the group, or emits, cannot be part of one rigid prototype.
            alone = [r for r in rprims if r.moving is not None or r.light is not None]
            together = [r for r in rprims if r.moving is None and r.light is None]
        for rprim in alone:
            self._sync_alone(group, rprim, places, len(rprims) == 1)
        if together:
            self._sync_together(group, together, places)

    def _sync_alone(self, group: Group, rprim: Rprim, places: list[Placed], only: bool) -> None:
        """only: there is nothing else in its group."""
        at_root = group.key is None
        overrides = _AS_BOUND if at_root else materials_of(places)
        given = _NOTHING_GIVEN if at_root else given_at(places)
        synced = self._reader.read(rprim, group.key, group.uniform, overrides, given)
        if synced is None:
            return
        prototype = self._prototype(synced)
        if prototype is None:
            return
        shared = synced.share_key is not None
        still = rprim.moving is None and rprim.light is None
        if at_root and still and not (shared and any(synced.data.shading_rate)):
            path, link_group = synced.mesh.data.path, -1
            if self._links:
                self._links.check_instance(path)
                link_group = self._links.group(path)
            material = synced.material if shared else None
            self._builder.add_single(path, prototype, synced.matrix(rprim), material, link_group)
            return
        own_rates = None
        if shared and any(synced.data.shading_rate):
            own_rates = np.array([synced.data.shading_rate], np.float32)
        own_matrix, own_motion = synced.matrix(rprim), self._own_motion(rprim, synced)
        for placed in places:
            path = synced.data.path if at_root else placed.path
            if not (at_root or only):
                path += str(rprim.path).removeprefix(str(group.path))
            material = placed.material
            if material is None and shared:
                material = synced.material
            matrices = product(own_matrix, placed.matrices)
            rates = combine(placed.rates, own_rates, len(matrices), 1)
            motion = compose(own_matrix[None], own_motion, placed.matrices, placed.motion)
            whole = replace(
                placed, path=path, matrices=matrices, material=material, rates=rates, motion=motion
            )
            if rprim.light is not None:
                self._add_mesh_lights(rprim.light, prototype, synced, whole)
            else:
                self._add_instances(prototype, whole, synced.reads)

    def _prototype(self, synced: SyncedRprim) -> int | None:
        """Of what is placed alone; one for all that share their geometry. None where core refuses it."""
        shared = synced.share_key is not None
        prototype = self._shared.get(synced.share_key) if shared else None
        if prototype is None:
            material = self._parts.materials.default if shared else synced.material
            mesh = self._builder.add_mesh(
                synced.mesh, material, synced.face_materials, synced.of_faces, own_rates=not shared
            )
            if mesh is None:
                return None
            prototype = self._builder.add_prototype(synced.data.path, (mesh,))
            if shared:
                self._shared[synced.share_key] = prototype
        return prototype

    def _own_motion(self, rprim: Rprim, synced: SyncedRprim) -> MatrixKeys | None:
        """(1, k, 4, 4) of a mesh in its group. An implicit shape's own matrix comes before its prim's."""
        keys = rprim.moving.keys() if rprim.moving else None
        if keys is None or synced.to_prim is None:
            return keys
        own: MatrixKeys = synced.matrix(rprim) @ np.linalg.inv(rprim.matrix) @ keys
        return own

    def _sync_together(self, group: Group, rprims: list[Rprim], places: list[Placed]) -> None:
        meshes = []
        given, reads = given_at(places), frozenset[str]()
        overrides = materials_of(places)
        for rprim in rprims:
            synced = self._reader.read(rprim, group.key, group.uniform, overrides, given)
            if synced is None:
                continue
            reads |= synced.reads
            placed_mesh = synced.mesh.transformed(synced.matrix(rprim))
            mesh = self._builder.add_mesh(
                placed_mesh, synced.material, synced.face_materials, synced.of_faces
            )
            if mesh is not None:
                meshes.append(mesh)
        if meshes:
            prototype = self._builder.add_prototype(str(group.path), meshes)
            for placed in places:
                self._add_instances(prototype, placed, reads)

    def _add_instances(self, prototype: int, placed: Placed, reads: Collection[str]) -> None:
        """Places a prototype; what moves apart from what does not. reads: what its materials read."""
        if self._links:
            self._links.check_instance(placed.path)
        motion = self._usable_motion(placed)
        parts = [(placed, motion)]
        if motion is not None:
            moves = moving_instances(motion)
            if not moves.all():
                parts = [(chosen(placed, ~moves), None)]
                parts += [(chosen(placed, moves), motion[moves])] if moves.any() else []
        for part, keys in parts:
            self._builder.add_instances(
                part.path,
                prototype,
                np.ascontiguousarray(part.matrices),
                part.ids,
                part.material,
                part.rates,
                keys,
                self._links.group(part.path),
                {name: values for name, values in part.primvars.items() if name in reads},
            )

    def _usable_motion(self, placed: Placed) -> MatrixKeys | None:
        """The motion, without that of instances which pass through a singular transform: they stay."""
        if placed.motion is None:
            return None
        regular = np.asarray(regular_matrices(placed.motion).all(axis=1))
        if regular.all():
            return placed.motion
        self._reports.add(
            "singular motion",
            "its transform cannot be inverted while the shutter is open (a scale of 0, for one), "
            "and it is not blurred by motion",
            placed.path,
        )
        motion: MatrixKeys = np.where(regular[:, None, None, None], placed.motion, placed.matrices[:, None])
        return motion

    def _require_instances(self) -> None:
        if self._builder.instance_count:
            return
        remedy = "Check visibility, --purposes and --mask, and that the stage holds meshes or implicit shapes"
        if len(self._reports):
            said = [report.line() for report in self._reports if report.severity is not Severity.NOTE]
            remedy = " ".join(said[:3]) or remedy
        raise StageError("no renderable prim", self._source, remedy)

    # Sprims

    def _camera(self) -> CameraData:
        prim, options, parts = self._parts.camera, self._options, self._parts
        if prim is None:
            bounds = parts.bounds(options.purposes, self._context)
            return frame_stage(bounds or self._builder.bounds(), self._context.stage)
        to_world = parts.population.world_matrix(prim)
        return read_camera(prim, to_world, self._context, depth_of_field=options.depth_of_field)

    def _light_places(self) -> Iterator[tuple[LightPrim, Usd.Prim, Matrix, str, bool]]:
        """All lights but meshes: with the prim at the place itself, matrix, path, and whether it moves."""
        for group in self._parts.groups:
            for placed in self._placed.get(id(group), ()):
                for light in group.lights:
                    path = str(light.prim.GetPath())
                    suffix = path if group.path.IsAbsoluteRootPath() else path.removeprefix(str(group.path))
                    for i, matrix in enumerate(placed.matrices):
                        place = placed.path_of(i) + suffix
                        moves = light.moves or placed.motion is not None
                        yield light, self._prim_at(place, light.prim), light.matrix @ matrix, place, moves

    def _prim_at(self, path: str, other: Usd.Prim) -> Usd.Prim:
        """The prim at a path, which is that of one instance of `other`; `other` inside of instancers."""
        if path == str(other.GetPath()) or "[" in path:
            return other
        return self._context.stage.GetPrimAtPath(path) or other

    def _light_prims(self) -> Iterator[Usd.Prim]:
        """All prims whose collections may restrict lights."""
        for _, prim, _, _, _ in self._light_places():
            yield prim
        for group in self._parts.groups:
            for rprim in group.rprims:
                if rprim.light is not None:
                    yield rprim.light

    def _sync_lights(self, camera: CameraData) -> None:
        found = [self._linked(data, prim) for data, prim in self._mesh_lights]
        for light, prim, matrix, path, moves in self._light_places():
            data = self._parts.lights.read(prim, matrix, path, self._context)
            if data is None:
                continue
            found.append(self._linked(data, prim))
            if moves:
                self._report_moving(light.prim)
        for data in found:
            self._builder.add_light(data)
        if not found and self._options.camera_light:
            self._builder.add_light(camera_light(camera.direction))

    def _report_moving(self, prim: Usd.Prim) -> None:
        self._reports.add(
            "moving light",
            "moves while the shutter is open: its light comes from where it is at the frame's time",
            prim.GetPath(),
        )

    def _linked(self, data: LightData, prim: Usd.Prim) -> LightData:
        """The light with the link groups that it lights and that are shadowed from it."""
        links = {
            "lit_groups": self._links.members(prim, "lightLink"),
            "shadow_groups": self._links.members(prim, "shadowLink"),
        }
        return replace(data, shape=data.shape | {name: groups for name, groups in links.items() if groups})

    def _add_mesh_lights(self, light: Usd.Prim, prototype: int, synced: SyncedRprim, placed: Placed) -> None:
        """Places a mesh that emits: each of its instances is a light."""
        tint = read_tint(light, (placed.material or synced.material).data, self._context)
        if not keeps_material(light):
            black = Primvar("constant", np.zeros((1, 3), np.float32), None)
            placed = replace(placed, material=self._parts.materials.fallback(black))
        for i in range(len(placed.matrices)):
            one = chosen(placed, np.arange(len(placed.matrices)) == i)
            instance = self._builder.instance_count
            self._add_instances(prototype, one, synced.reads)
            data = self._parts.lights.read_mesh(
                light, one.matrices[0], one.path_of(0), synced.data, tint, self._context
            )
            if data is not None:
                shape = data.shape | {"instance": instance}
                self._mesh_lights.append((replace(data, shape=shape), light))
                if one.motion is not None:
                    self._report_moving(light)
