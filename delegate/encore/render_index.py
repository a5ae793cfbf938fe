"""A stage, and its translation to the scene that core renders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd

from encore.adapters.camera import (
    CameraData,
    ShutterOptions,
    choose_camera,
    frame_stage,
    image_size,
    read_camera,
    read_shutter,
    stage_bounds,
)
from encore.adapters.context import Matrix, SyncContext
from encore.adapters.instancer import Matrices, regular_matrices, report_singular
from encore.adapters.light import LightData, camera_light, read_light
from encore.adapters.linking import Links
from encore.adapters.material import bound_materials
from encore.adapters.matrix_motion import MatrixKeys, compose, moving_instances
from encore.adapters.mesh_light import keeps_material, read_mesh_light, read_tint
from encore.adapters.motion import stage_shutter
from encore.adapters.primvars import Primvar
from encore.adapters.shading_rate import NO_RATES, RateArray, combine
from encore.errors import StageError
from encore.population import Group, LightPrim, Population, Rprim
from encore.render_delegate import BoundMaterial, RenderDelegate
from encore.report import Reports, Severity
from encore.rprims import RprimReader, SyncedRprim


@dataclass(frozen=True)
class SyncOptions:
    """What is translated.

    camera: path or name; empty: choose_camera() says which. purposes: of prims. material_purposes: of
    bindings, tried in order. width and height in pixels; without a height, the camera decides it.
    camera_light: one along the view where there are no lights. strict: what is broken on the stage raises
    StageError. shutter: whether motion is blurred, and the interval. depth_of_field: whether the lens blurs.
    """

    camera: str = ""
    purposes: tuple[str, ...] = ("default", "proxy")
    material_purposes: tuple[str, ...] = ("full",)
    time: Usd.TimeCode = field(default_factory=Usd.TimeCode.Default)
    width: int = 960
    height: int | None = None
    camera_light: bool = True
    strict: bool = False
    shutter: ShutterOptions = field(default_factory=ShutterOptions)
    depth_of_field: bool = True


@dataclass(frozen=True)
class Translation:
    """A stage at a time, ready to render.

    scene: encore._core.Scene. camera_path: empty for the automatic camera. camera_aspect: width / height of
    its film window. counts: meshes, prototypes, instances, lights, materials and textures of the scene.
    shutter: in frames from the frame's time; open and close are equal where motion is not blurred.
    lens: whether what is out of focus is blurred.
    """

    scene: Any
    camera_path: str
    camera_aspect: float
    width: int
    height: int
    reports: Reports
    counts: Mapping[str, int]
    shutter: tuple[float, float] = (0.0, 0.0)
    lens: bool = False


class RenderIndex:
    """Knows the stage's prims, and syncs them to a scene."""

    def __init__(self, stage: Usd.Stage, options: SyncOptions | None = None) -> None:
        self.stage = stage
        self.options = options or SyncOptions()

    def sync(self, time: Usd.TimeCode | None = None) -> Translation:
        """Translates the stage at a time (else the options').

        Raises StageError where nothing can be rendered, for an unknown camera, and with strict.
        """
        return _Sync(self.stage, self.options, self.options.time if time is None else time).run()


@dataclass(frozen=True)
class _Placed:
    """Where a group is in the world: path, or path[id].

    material: replaces that of all its meshes. rates: per matrix, replace theirs where above 0. motion: (n, k,
    4, 4) keys over the shutter, where any of the n matrices moves.
    """

    matrices: Matrices
    path: str = ""
    ids: npt.NDArray[np.int64] | None = None
    material: BoundMaterial | None = None
    rates: RateArray | None = None
    motion: MatrixKeys | None = None

    def path_of(self, index: int) -> str:
        return self.path if self.ids is None else f"{self.path}[{self.ids[index]}]"


class _Sync:
    """One translation: walk the stage, resolve materials, add meshes and instances, camera, lights."""

    def __init__(self, stage: Usd.Stage, options: SyncOptions, time: Usd.TimeCode) -> None:
        self._stage = stage
        self._options = options
        self._reports = Reports()
        still = SyncContext(stage, time, self._reports)
        self._camera_prim = choose_camera(stage, options.camera, still)
        self._shutter = (0.0, 0.0)
        if self._camera_prim is not None:
            self._shutter = read_shutter(self._camera_prim, options.shutter, still)
        self._context = replace(still, shutter=stage_shutter(time, self._shutter, stage))
        self._delegate = RenderDelegate(self._context)
        self._population = Population(options.purposes, options.material_purposes, self._context)
        self._bound: dict[Sdf.Path, BoundMaterial | None] = {}
        self._reader = RprimReader(self._delegate, self._bound, self._context)
        self._placed: dict[int, list[_Placed]] = {}  # by id of the group
        self._shared: dict[Any, int] = {}  # prototypes by SyncedRprim.share_key
        self._links = Links((), self._context)
        self._mesh_lights: list[tuple[LightData, Usd.Prim]] = []

    def run(self) -> Translation:
        self._report_composition()
        root = self._population.populate()
        self._bind()
        self._place(root, _Placed(np.eye(4)[None]))
        self._links = Links(self._light_prims(), self._context)
        for group in self._population.groups:
            self._sync_rprims(group, self._placed.get(id(group), []))
        self._require_instances()
        camera = self._camera()
        width, height = image_size(self._options.width, self._options.height, camera.aspect)
        self._delegate.set_camera(camera, width, height)
        self._sync_lights(camera)
        if self._options.strict and self._reports.has_errors:
            raise StageError(_summary(self._reports), self._source, "Repair it, or render without --strict")
        scene = self._delegate.scene
        counts = {
            "meshes": scene.mesh_count,
            "prototypes": scene.prototype_count,
            "instances": scene.instance_count,
            "lights": scene.light_count,
            "materials": scene.material_count,
            "textures": scene.texture_count,
        }
        return Translation(
            scene,
            camera.path,
            camera.aspect,
            width,
            height,
            self._reports,
            counts,
            self._shutter,
            camera.lens_radius > 0,
        )

    @property
    def _source(self) -> str:
        return str(self._stage.GetRootLayer().identifier)

    def _report_composition(self) -> None:
        """Broken references and the like: what they would have brought is missing."""
        if not hasattr(self._stage, "GetCompositionErrors"):  # older versions of USD lack it
            return
        for error in self._stage.GetCompositionErrors():
            text = " ".join(str(error).split())
            self._reports.error(f"composition {error.errorType}", text, error.rootSite.path)

    def _bind(self) -> None:
        """Resolves the material bindings of all prims at once."""
        prims: dict[Sdf.Path, Usd.Prim] = {}
        for group in self._population.groups:
            for rprim in () if group.uniform else group.rprims:
                prims[rprim.prim.GetPath()] = rprim.prim
                prims |= {s.GetPath(): s.GetPrim() for s in rprim.subsets}
            prims |= {c.bound.GetPath(): c.bound for c in group.children if c.bound}
        found = bound_materials(list(prims.values()), self._options.material_purposes)
        for path, material in zip(prims, found, strict=True):
            self._bound[path] = self._delegate.material(material) if material else None

    def _place(self, group: Group, placed: _Placed) -> None:
        """Notes where a group is in the world, and all that is placed in it."""
        self._placed.setdefault(id(group), []).append(placed)
        for child in group.children:
            matrices = (child.matrices[None] @ placed.matrices[:, None]).reshape(-1, 4, 4)
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
            regular = regular_matrices(matrices)
            if not regular.all():
                report_singular(path, self._context)
                matrices, ids = matrices[regular], None if ids is None else ids[regular]
                rates = None if rates is None else rates[regular]
                motion = None if motion is None else motion[regular]
            if len(matrices):
                self._place(child.group, _Placed(matrices, path, ids, material, rates, motion))

    # Rprims

    def _sync_rprims(self, group: Group, places: list[_Placed]) -> None:
        """Meshes that are placed alone stay in their own space; those placed together share the group's."""
        places = [p for p in places if p.material is None or not p.material.data.cut_out]
        if not places or not group.rprims:
            return
        regular = regular_matrices(np.stack([r.matrix for r in group.rprims]))
        rprims = [r for r, usable in zip(group.rprims, regular, strict=True) if usable]
        for rprim, usable in zip(group.rprims, regular, strict=True):
            if not usable:
                report_singular(str(rprim.prim.GetPath()), self._context)
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

    def _sync_alone(self, group: Group, rprim: Rprim, places: list[_Placed], only: bool) -> None:
        """only: there is nothing else in its group."""
        synced = self._reader.read(rprim, group.uniform, [p.material for p in places])
        if synced is None:
            return
        shared = synced.share_key is not None
        prototype = self._shared.get(synced.share_key) if shared else None
        own_rates = None
        if shared and any(synced.data.shading_rate):
            own_rates = np.array([synced.data.shading_rate], np.float32)
        if prototype is None:
            data = replace(synced.data, shading_rate=NO_RATES) if shared else synced.data
            mesh_material = self._delegate.default_material if shared else synced.material
            mesh = self._delegate.add_mesh(data, mesh_material, synced.face_materials)
            if mesh is None:
                return
            prototype = self._delegate.add_prototype(synced.data.path, [mesh])
            if shared:
                self._shared[synced.share_key] = prototype
        at_root = group.path.IsAbsoluteRootPath()
        own_motion = self._own_motion(rprim, synced)
        for placed in places:
            path = synced.data.path if at_root else placed.path
            if not (at_root or only):
                path += str(rprim.prim.GetPath()).removeprefix(str(group.path))
            material = placed.material
            if material is None and shared:
                material = synced.material
            matrices = synced.matrix @ placed.matrices
            rates = combine(placed.rates, own_rates, len(matrices), 1)
            motion = compose(synced.matrix[None], own_motion, placed.matrices, placed.motion)
            whole = replace(
                placed, path=path, matrices=matrices, material=material, rates=rates, motion=motion
            )
            if rprim.light is not None:
                self._add_mesh_lights(rprim.light, prototype, synced, whole)
            else:
                self._add_instances(prototype, whole)

    def _own_motion(self, rprim: Rprim, synced: SyncedRprim) -> MatrixKeys | None:
        """(1, k, 4, 4) of a mesh in its group. An implicit shape's own matrix comes before its prim's."""
        keys = rprim.moving.keys() if rprim.moving else None
        if keys is None or synced.matrix is rprim.matrix:
            return keys
        own: MatrixKeys = synced.matrix @ np.linalg.inv(rprim.matrix) @ keys
        return own

    def _sync_together(self, group: Group, rprims: list[Rprim], places: list[_Placed]) -> None:
        meshes = []
        for rprim in rprims:
            synced = self._reader.read(rprim, group.uniform, [p.material for p in places])
            if synced is None:
                continue
            data = synced.data.transformed(synced.matrix)
            mesh = self._delegate.add_mesh(data, synced.material, synced.face_materials)
            if mesh is not None:
                meshes.append(mesh)
        if meshes:
            prototype = self._delegate.add_prototype(str(group.path), meshes)
            for placed in places:
                self._add_instances(prototype, placed)

    def _add_instances(self, prototype: int, placed: _Placed) -> None:
        """Places a prototype; what moves apart from what does not."""
        if self._links:
            self._links.check_instance(placed.path)
        motion = self._usable_motion(placed)
        parts = [(placed, motion)]
        if motion is not None:
            moves = moving_instances(motion)
            if not moves.all():
                parts = [(_chosen(placed, ~moves), None)]
                parts += [(_chosen(placed, moves), motion[moves])] if moves.any() else []
        for part, keys in parts:
            self._delegate.add_instances(
                part.path,
                prototype,
                np.ascontiguousarray(part.matrices),
                part.ids,
                part.material,
                part.rates,
                keys,
                self._links.group(part.path),
            )

    def _usable_motion(self, placed: _Placed) -> MatrixKeys | None:
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
        if self._delegate.scene.instance_count:
            return
        remedy = "Check visibility, --purposes and --mask, and that the stage holds meshes or implicit shapes"
        if len(self._reports):
            said = [report.line() for report in self._reports if report.severity is not Severity.NOTE]
            remedy = " ".join(said[:3]) or remedy
        raise StageError("no renderable prim", self._source, remedy)

    # Sprims

    def _camera(self) -> CameraData:
        prim, options = self._camera_prim, self._options
        if prim is None:
            depth = self._population.depth
            bounds = stage_bounds(self._stage, depth, options.purposes, self._context)
            return frame_stage(bounds or self._delegate.bounds(), self._stage)
        to_world = self._population.world_matrix(prim)
        return read_camera(prim, to_world, self._context, depth_of_field=options.depth_of_field)

    def _light_places(self) -> Iterator[tuple[LightPrim, Usd.Prim, Matrix, str, bool]]:
        """All lights but meshes: with the prim at the place itself, matrix, path, and whether it moves."""
        for group in self._population.groups:
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
        return self._stage.GetPrimAtPath(path) or other

    def _light_prims(self) -> Iterator[Usd.Prim]:
        """All prims whose collections may restrict lights."""
        for _, prim, _, _, _ in self._light_places():
            yield prim
        for group in self._population.groups:
            for rprim in group.rprims:
                if rprim.light is not None:
                    yield rprim.light

    def _sync_lights(self, camera: CameraData) -> None:
        found = [self._linked(data, prim) for data, prim in self._mesh_lights]
        for light, prim, matrix, path, moves in self._light_places():
            data = read_light(prim, matrix, path, self._delegate.textures, self._context)
            if data is None:
                continue
            found.append(self._linked(data, prim))
            if moves:
                self._report_moving(light.prim)
        for data in found:
            self._delegate.add_light(data)
        if not found and self._options.camera_light:
            self._delegate.add_light(camera_light(camera.direction))

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

    def _add_mesh_lights(self, light: Usd.Prim, prototype: int, synced: SyncedRprim, placed: _Placed) -> None:
        """Places a mesh that emits: each of its instances is a light."""
        tint = read_tint(light, (placed.material or synced.material).data, self._context)
        if not keeps_material(light):
            black = Primvar("constant", np.zeros((1, 3), np.float32), None)
            placed = replace(placed, material=self._delegate.fallback_material(black))
        for i in range(len(placed.matrices)):
            one = _chosen(placed, np.arange(len(placed.matrices)) == i)
            instance = self._delegate.scene.instance_count
            self._add_instances(prototype, one)
            data = read_mesh_light(light, one.matrices[0], one.path_of(0), synced.data, tint, self._context)
            if data is not None:
                shape = data.shape | {"instance": instance}
                self._mesh_lights.append((replace(data, shape=shape), light))
                if one.motion is not None:
                    self._report_moving(light)


def _chosen(placed: _Placed, which: npt.NDArray[np.bool_]) -> _Placed:
    """Some of the places."""
    return replace(
        placed,
        matrices=placed.matrices[which],
        ids=None if placed.ids is None else placed.ids[which],
        rates=None if placed.rates is None else placed.rates[which],
        motion=None if placed.motion is None else placed.motion[which],
    )


def _summary(reports: Reports) -> str:
    """What --strict says: the first errors, and how many there are."""
    errors = reports.errors
    first = "; ".join(f"{e.path}: {e.message}" for e in errors[:3])
    return first + (f"; and {len(errors) - 3} more kinds" if len(errors) > 3 else "")
