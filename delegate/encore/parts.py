"""What is known of a stage from one sync to the next, and what of it changes make void."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from encore.adapters.camera import choose_camera, read_shutter, stage_bounds
from encore.adapters.context import Matrix, SyncContext
from encore.adapters.light import Colour, LightData, read_light
from encore.adapters.material import bound_materials, report_dangling
from encore.adapters.mesh import MeshData
from encore.adapters.mesh_light import read_mesh_light
from encore.adapters.motion import stage_shutter
from encore.adapters.primvars import might_vary
from encore.adapters.texture import Textures
from encore.change_tracker import BINDINGS, GEOMETRY, Changes, DirtyBits
from encore.groups import Group
from encore.materials import Materials
from encore.population import Population
from encore.report import Log, Reports
from encore.rprim_cache import RprimCache

if TYPE_CHECKING:
    from encore.render_index import SyncOptions

# What decides the bounds of the stage, by which the automatic camera frames it: sizes of lights too.
_BOUNDS = ~(DirtyBits.RESOURCE | BINDINGS)


class _Light:
    """What is known of a light at a place: what it was read for, what it came to, and its reports."""

    __slots__ = ("data", "inputs", "log", "matrix", "prim", "textures", "volatile")

    def __init__(self, prim: Usd.Prim, matrix: Matrix, inputs: tuple[Any, ...]) -> None:
        self.prim = prim
        self.matrix = matrix
        self.inputs = inputs
        self.data: LightData | None = None
        self.log: Log = ()
        self.textures: tuple[int, ...] = ()
        self.volatile = False


class _Same:
    """What is equal to itself only."""

    __slots__ = ("value",)

    def __init__(self, value: object) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value

    __hash__ = None  # type: ignore[assignment]


class Lights:
    """By place: the path of the prim or of its instance. count: how many were read in this frame."""

    def __init__(self, textures: Textures) -> None:
        self.count = 0
        self._textures = textures
        self._known: dict[str, _Light] = {}

    def begin(self, forget: Callable[[Usd.Prim], bool], stale: frozenset[int]) -> None:
        """Starts a frame. forget: says of a light's prim whether it has to be read again."""
        self.count = 0
        self._known = {
            path: known
            for path, known in self._known.items()
            if known.prim
            and not known.volatile
            and stale.isdisjoint(known.textures)
            and not forget(known.prim)
        }

    def read(self, prim: Usd.Prim, matrix: Matrix, path: str, context: SyncContext) -> LightData | None:
        """encore.adapters.light.read_light()."""
        return self._kept(
            prim, matrix, path, (), context, lambda: read_light(prim, matrix, path, self._textures, context)
        )

    def read_mesh(
        self,
        prim: Usd.Prim,
        matrix: Matrix,
        path: str,
        data: MeshData,
        tint: Colour,
        context: SyncContext,
    ) -> LightData | None:
        """encore.adapters.mesh_light.read_mesh_light()."""
        return self._kept(
            prim,
            matrix,
            path,
            (_Same(data), tint),
            context,
            lambda: read_mesh_light(prim, matrix, path, data, tint, context),
        )

    def _kept(
        self,
        prim: Usd.Prim,
        matrix: Matrix,
        path: str,
        inputs: tuple[Any, ...],
        context: SyncContext,
        read: Callable[[], LightData | None],
    ) -> LightData | None:
        known = self._known.get(path)
        if known is not None and known.inputs == inputs and np.array_equal(known.matrix, matrix):
            context.reports.replay(known.log)
            return known.data
        self.count += 1
        known = self._known[path] = _Light(prim, matrix, inputs)
        mark, self._textures.volatile = context.reports.mark, False
        self._textures.touched.clear()
        known.data = read()
        known.textures = tuple(self._textures.touched)
        known.volatile = self._textures.volatile
        known.log = context.reports.since(mark)
        return known.data


class Parts:
    """Population, materials, rprims, lights and camera of a stage. begin() makes them current."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.camera: Usd.Prim | None = None
        self.shutter = (0.0, 0.0)  # in frames from the frame's time
        self.textures = Textures()
        self.materials = Materials(self.textures)
        self.rprims = RprimCache()
        self.lights = Lights(self.textures)
        self._stage = stage
        self._population: Population | None = None
        self._options: SyncOptions | None = None
        self._clock: tuple[Any, ...] = ()
        self._bound: dict[Sdf.Path, UsdShade.Material | None] = {}
        self._dangling: dict[Sdf.Path, Usd.Relationship] = {}  # bindings that name no material, by prim
        self._resolved = 0
        self._camera_log: Log | None = None
        self._composition: Log | None = None
        self._bounds: tuple[Gf.Range3d | None] | None = None

    @property
    def population(self) -> Population:
        assert self._population is not None, "begin() comes first"
        return self._population

    @property
    def root(self) -> Group:
        return self.population.groups[0]

    @property
    def groups(self) -> list[Group]:
        return self.population.groups

    @property
    def counts(self) -> dict[str, int]:
        """Of encore.render_index.SyncCounts."""
        return {
            "prims_walked": self.population.prims_walked,
            "rprims_read": self.rprims.read,
            "materials_read": self.materials.read,
            "lights_read": self.lights.count,
            "bindings_resolved": self._resolved,
        }

    def begin(
        self, options: SyncOptions, time: Usd.TimeCode, changes: Changes, reports: Reports
    ) -> SyncContext:
        """Starts a frame: forgets what has changed, and walks the stage as far as that is needed."""
        before, self._options = self._options, options
        still = SyncContext(self._stage, time, reports)
        if before is None or (before.purposes, before.material_purposes) != (
            options.purposes,
            options.material_purposes,
        ):
            self._population = None
            self._bound = {}
        if changes.everything or changes.resynced or before is None or before.camera != options.camera:
            self._camera_log = None
        if before is None or before.aov_primvars != options.aov_primvars:
            if before is not None:
                self._forget_everything()
            self.rprims.aov_primvars = frozenset(name for name, _ in options.aov_primvars)
        self._choose_camera(options, still)
        context = replace(still, shutter=stage_shutter(time, self.shutter, self._stage))
        clock, self._clock = self._clock, (time, context.shutter)
        other_time = clock != self._clock
        # A value at the default time need not be that of any other time, even where there are no samples.
        if changes.everything or (other_time and clock and clock[0].IsDefault() != time.IsDefault()):
            self._forget_everything()
        stale = self.textures.begin(context)
        self.materials.begin(stale)
        self.rprims.begin()
        self._forget(changes, other_time, stale)
        self._report_composition(reports, changes)
        if self._population is None:
            self._population = Population(options.purposes, options.material_purposes, context)
            self._population.aov_primvars = self.rprims.aov_primvars
            self._population.populate(context)
        else:
            self._population.update(context, changes, other_time)
        self.rprims.keep_groups({group.key for group in self._population.groups})
        return context

    def bindings(
        self, prims: Mapping[Sdf.Path, Usd.Prim], reports: Reports
    ) -> dict[Sdf.Path, UsdShade.Material | None]:
        """Materials of prims by path, in the order of the prims."""
        assert self._options is not None
        missing = [path for path in prims if path not in self._bound]
        self._resolved = len(missing)
        if missing:
            dangling: dict[Sdf.Path, Usd.Relationship] = {}
            found = bound_materials([prims[p] for p in missing], self._options.material_purposes, dangling)
            self._bound.update(zip(missing, found, strict=True))
            stay = self._dangling.keys() - missing
            self._dangling = {p: b for p, b in self._dangling.items() if p in stay} | dangling
        for path, binding in self._dangling.items():
            if path in prims and self._bound[path] is None:  # else another purpose has one
                report_dangling(binding, reports)
        return {path: self._bound[path] for path in prims}

    def bounds(self, purposes: tuple[str, ...], context: SyncContext) -> Gf.Range3d | None:
        """encore.adapters.camera.stage_bounds()."""
        if self._bounds is None:
            self._bounds = (stage_bounds(self._stage, self.population.depth, purposes, context),)
        return self._bounds[0]

    # What is void

    def _forget_everything(self) -> None:
        self._population = None
        self._bound = {}
        self._bounds = self._composition = None
        self.materials.clear()
        self.rprims.clear()
        self.lights.begin(lambda _: True, frozenset())

    def _forget(self, changes: Changes, other_time: bool, stale: frozenset[int]) -> None:
        bits = changes.bits
        covers = _covering(changes.resynced)
        if changes.resynced:
            self._composition = None
        if bits & BINDINGS:
            self._bound = {}
        if other_time or bits & _BOUNDS or self._population is None:
            self._bounds = None
        self.materials.forget(changes.prims.keys(), changes.resynced, self._stage)
        if other_time:
            self.materials.forget_varying(self._stage)
        self._forget_rprims(changes, other_time, covers)

        def forget(prim: Usd.Prim) -> bool:
            path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
            return path in changes.prims or covers(path) or (other_time and might_vary(prim))

        self.lights.begin(forget, stale)

    def _forget_rprims(self, changes: Changes, other_time: bool, covers: Callable[[Sdf.Path], bool]) -> None:
        if not changes and not other_time:
            return
        changed = changes.having(GEOMETRY) | changes.renamed
        # Subsets belong to what they are below.
        changed |= {path.GetParentPath() for path in changes.prims} | {
            path.GetParentPath() for path in changes.resynced
        }
        passing = changes.having(DirtyBits.PRIMVAR)
        inherited: dict[tuple[Sdf.Path, ...], bool] = {}
        for entry in self.rprims.entries.values():
            stale = inherited.get(entry.inherited)
            if stale is None:
                stale = inherited[entry.inherited] = not passing.isdisjoint(
                    p.GetPrimPath() for p in entry.inherited
                ) or (other_time and self._varies(entry.inherited))
            depends = entry.geometry.depends if entry.geometry is not None else ()
            entry.stale = bool(
                entry.stale
                or entry.source in changed
                or not entry.prim
                or (changes.resynced and covers(entry.source))
                or any(path in changes.prims or covers(path) for path in depends)
                or stale
                or (other_time and entry.might_vary())
            )
        if changes.resynced:
            self.rprims.entries = {k: e for k, e in self.rprims.entries.items() if not e.stale}

    def _varies(self, attributes: tuple[Sdf.Path, ...]) -> bool:
        found = (self._stage.GetAttributeAtPath(path) for path in attributes)
        # A primvar varies with its indices as well.
        return any(a and UsdGeom.Primvar(a).ValueMightBeTimeVarying() for a in found)

    # The camera, and what USD says of the stage

    def _choose_camera(self, options: SyncOptions, still: SyncContext) -> None:
        if self._camera_log is None:
            mark = still.reports.mark
            self.camera = choose_camera(self._stage, options.camera, still)
            self._camera_log = still.reports.since(mark)
        else:
            still.reports.replay(self._camera_log)
        self.shutter = (0.0, 0.0)
        if self.camera is not None:
            self.shutter = read_shutter(self.camera, options.shutter, still)

    def _report_composition(self, reports: Reports, changes: Changes) -> None:
        """Broken references and the like: what they would have brought is missing."""
        if self._composition is not None:
            reports.replay(self._composition)
            return
        mark = reports.mark
        # Older versions of USD lack it.
        for error in getattr(self._stage, "GetCompositionErrors", list)():
            text = " ".join(str(error).split())
            reports.error(f"composition {error.errorType}", text, error.rootSite.path)
        self._composition = reports.since(mark)


def _covering(roots: set[Sdf.Path]) -> Callable[[Sdf.Path], bool]:
    """Says of a path whether it is one of the roots, or below one."""
    if len(roots) < 8:
        return lambda path: any(path.HasPrefix(root) for root in roots)
    return lambda path: not roots.isdisjoint(path.GetPrefixes())
