"""A stage, and its translation to the scene that core renders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd

from encore.adapters.camera import (
    CameraData,
    choose_camera,
    frame_stage,
    image_size,
    read_camera,
    stage_bounds,
)
from encore.adapters.context import SyncContext
from encore.adapters.instancer import Matrices, regular_matrices, report_singular
from encore.adapters.light import camera_light, read_light
from encore.adapters.material import bound_materials
from encore.adapters.shading_rate import NO_RATES, RateArray, combine
from encore.errors import StageError
from encore.population import Group, Population, Rprim
from encore.render_delegate import BoundMaterial, RenderDelegate
from encore.report import Reports
from encore.rprims import RprimReader


@dataclass(frozen=True)
class SyncOptions:
    """What is translated.

    camera: path or name; empty: choose_camera() says which. purposes: of prims. material_purposes: of
    bindings, tried in order. width and height in pixels; without a height, the camera decides it.
    camera_light: one along the view where there are no lights. strict: what is broken on the stage raises
    StageError.
    """

    camera: str = ""
    purposes: tuple[str, ...] = ("default", "proxy")
    material_purposes: tuple[str, ...] = ("full",)
    time: Usd.TimeCode = field(default_factory=Usd.TimeCode.Default)
    width: int = 960
    height: int | None = None
    camera_light: bool = True
    strict: bool = False


@dataclass(frozen=True)
class Translation:
    """A stage at a time, ready to render.

    scene: encore._core.Scene. camera_path: empty for the automatic camera. camera_aspect: width / height of
    its film window. counts: meshes, prototypes, instances, lights, materials and textures of the scene.
    """

    scene: Any
    camera_path: str
    camera_aspect: float
    width: int
    height: int
    reports: Reports
    counts: Mapping[str, int]


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

    material: replaces that of all its meshes. rates: per matrix, replace theirs where above 0.
    """

    matrices: Matrices
    path: str = ""
    ids: npt.NDArray[np.int64] | None = None
    material: BoundMaterial | None = None
    rates: RateArray | None = None

    def path_of(self, index: int) -> str:
        return self.path if self.ids is None else f"{self.path}[{self.ids[index]}]"


class _Sync:
    """One translation: walk the stage, resolve materials, add meshes and instances, camera, lights."""

    def __init__(self, stage: Usd.Stage, options: SyncOptions, time: Usd.TimeCode) -> None:
        self._stage = stage
        self._options = options
        self._reports = Reports()
        self._context = SyncContext(stage, time, self._reports)
        self._delegate = RenderDelegate(self._context)
        self._population = Population(options.purposes, options.material_purposes, self._context)
        self._bound: dict[Sdf.Path, BoundMaterial | None] = {}
        self._reader = RprimReader(self._delegate, self._bound, self._context)
        self._placed: dict[int, list[_Placed]] = {}  # by id of the group
        self._shared: dict[Any, int] = {}  # prototypes by SyncedRprim.share_key

    def run(self) -> Translation:
        self._report_composition()
        root = self._population.populate()
        self._bind()
        self._place(root, _Placed(np.eye(4)[None]))
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
        return Translation(scene, camera.path, camera.aspect, width, height, self._reports, counts)

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
            regular = regular_matrices(matrices)
            if not regular.all():
                report_singular(path, self._context)
                matrices, ids = matrices[regular], None if ids is None else ids[regular]
                rates = None if rates is None else rates[regular]
            if len(matrices):
                self._place(child.group, _Placed(matrices, path, ids, material, rates))

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
            for rprim in rprims:
                self._sync_alone(group, rprim, places)
        else:
            self._sync_together(group, rprims, places)

    def _sync_alone(self, group: Group, rprim: Rprim, places: list[_Placed]) -> None:
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
        for placed in places:
            path = synced.data.path if at_root else placed.path
            material = placed.material
            if material is None and shared:
                material = synced.material
            matrices = synced.matrix @ placed.matrices
            rates = combine(placed.rates, own_rates, len(matrices), 1)
            self._delegate.add_instances(path, prototype, matrices, placed.ids, material, rates)

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
                self._delegate.add_instances(
                    placed.path, prototype, placed.matrices, placed.ids, placed.material, placed.rates
                )

    def _require_instances(self) -> None:
        if self._delegate.scene.instance_count:
            return
        remedy = "Check visibility, --purposes and --mask, and that the stage holds meshes or implicit shapes"
        if len(self._reports):
            remedy = " ".join(self._reports.lines()[:3])
        raise StageError("no renderable prim", self._source, remedy)

    # Sprims

    def _camera(self) -> CameraData:
        prim = choose_camera(self._stage, self._options.camera, self._context)
        if prim is None:
            depth = self._population.depth
            bounds = stage_bounds(self._stage, depth, self._options.purposes, self._context)
            return frame_stage(bounds or self._delegate.bounds(), self._stage)
        return read_camera(prim, self._population.world_matrix(prim), self._context)

    def _sync_lights(self, camera: CameraData) -> None:
        found = False
        for group in self._population.groups:
            for placed in self._placed.get(id(group), ()):
                for light in group.lights:
                    path = str(light.prim.GetPath())
                    suffix = path if group.path.IsAbsoluteRootPath() else path.removeprefix(str(group.path))
                    for i, matrix in enumerate(placed.matrices):
                        data = read_light(
                            light.prim, light.matrix @ matrix, placed.path_of(i) + suffix, self._context
                        )
                        if data is not None:
                            found = True
                            self._delegate.add_light(data)
        if not found and self._options.camera_light:
            self._delegate.add_light(camera_light(camera.direction))


def _summary(reports: Reports) -> str:
    """What --strict says: the first errors, and how many there are."""
    errors = reports.errors
    first = "; ".join(f"{e.path}: {e.message}" for e in errors[:3])
    return first + (f"; and {len(errors) - 3} more kinds" if len(errors) > 3 else "")
