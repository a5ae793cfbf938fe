"""A stage, and its translation to the scene that core renders."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from pxr import Usd

from encore.adapters.camera import CameraData, FilmOptions, ShutterOptions, conform
from encore.assembly import Assembly
from encore.change_tracker import ChangeTracker
from encore.errors import StageError
from encore.parts import Parts
from encore.report import Reports
from encore.scene_builder import set_camera


@dataclass(frozen=True)
class SyncOptions:
    """What is translated.

    camera: path or name; empty: choose_camera() says which. purposes: of prims. material_purposes: of
    bindings, tried in order. width and height in pixels; without a height, the camera decides it.
    camera_light: one along the view where there are no lights. strict: what is broken on the stage raises
    StageError. shutter: whether motion is blurred, and the interval. depth_of_field: whether the lens blurs.
    pixel_aspect_ratio and conform_policy: FilmOptions'. aov_primvars: name and components of those that
    images show, whatever materials read.
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
    pixel_aspect_ratio: float = 1.0
    conform_policy: str = FilmOptions.conform_policy
    aov_primvars: tuple[tuple[str, int], ...] = ()

    @property
    def film(self) -> FilmOptions:
        return FilmOptions(self.width, self.height, self.pixel_aspect_ratio, self.conform_policy)


@dataclass(frozen=True)
class Translation:
    """A stage at a time, ready to render.

    scene: encore._core.Scene. camera_path: empty for the automatic camera. camera_aspect: width / height of
    its film window. counts: meshes, prototypes, instances, lights, materials and textures of the scene.
    shutter: in frames from the frame's time; open and close are equal where motion is not blurred.
    lens: whether what is out of focus is blurred. pixel_aspect_ratio: width / height of a pixel.
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
    pixel_aspect_ratio: float = 1.0
    camera: CameraData | None = None

    def on_film(self, options: FilmOptions) -> Translation:
        """The same scene on another film; this translation is not to be rendered any more."""
        if self.camera is None:
            raise ValueError("a translation without its camera has only one film")
        film = conform(self.camera, options)
        set_camera(self.scene, self.camera, film)
        return replace(self, width=film.width, height=film.height, pixel_aspect_ratio=film.pixel_aspect_ratio)


@dataclass(frozen=True)
class SyncCounts:
    """What one sync has read of the stage; the rest it knew already.

    prims_walked: looked at for what they are and where. rprims_read: whose geometry was. bindings_resolved:
    prims of which the material was looked for.
    """

    prims_walked: int = 0
    rprims_read: int = 0
    materials_read: int = 0
    lights_read: int = 0
    bindings_resolved: int = 0


class RenderIndex:
    """Knows the stage's prims, and syncs them to scenes.

    What is read is kept until it changes on the stage, or with the time. options may be replaced between
    syncs. last_sync: what the last one has read.
    """

    def __init__(self, stage: Usd.Stage, options: SyncOptions | None = None) -> None:
        self.stage = stage
        self.options = options or SyncOptions()
        self.change_tracker = ChangeTracker(stage)
        self.last_sync = SyncCounts()
        self._parts = Parts(stage)

    def sync(self, time: Usd.TimeCode | None = None) -> Translation:
        """Translates the stage at a time (else the options'), as it is now: always to a new scene.

        It is the one that a new RenderIndex would come to. Raises StageError where nothing can be rendered,
        for an unknown camera, and with strict.
        """
        with _no_garbage_collection():
            try:
                return self._sync(self.options.time if time is None else time)
            except BaseException:
                # What was being read may be half known.
                self.change_tracker.mark_all_dirty()
                raise

    def _sync(self, time: Usd.TimeCode) -> Translation:
        options, reports = self.options, Reports()
        context = self._parts.begin(options, time, self.change_tracker.take(), reports)
        scene, camera = Assembly(self._parts, options, context).assemble()
        film = conform(camera, options.film)
        set_camera(scene, camera, film)
        self.last_sync = SyncCounts(**self._parts.counts)
        if options.strict and reports.has_errors:
            source = str(self.stage.GetRootLayer().identifier)
            raise StageError(_summary(reports), source, "Repair it, or render without --strict")
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
            film.width,
            film.height,
            reports,
            counts,
            self._parts.shutter,
            camera.lens_radius > 0,
            film.pixel_aspect_ratio,
            camera,
        )


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """What a sync makes stays, and looking through it again and again takes longer than making it."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            if not gc.get_freeze_count():
                # To the oldest generation, or all of it would be looked through at once.
                gc.freeze()
                gc.unfreeze()
            gc.enable()


def _summary(reports: Reports) -> str:
    """What --strict says: the first errors, and how many there are."""
    errors = reports.errors
    first = "; ".join(f"{e.path}: {e.message}" for e in errors[:3])
    return first + (f"; and {len(errors) - 3} more kinds" if len(errors) > 3 else "")
