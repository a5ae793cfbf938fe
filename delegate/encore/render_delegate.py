"""What Encore offers to a host, in the shape of Hydra's render delegate."""

from __future__ import annotations

import resource
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Usd

from encore import aov
from encore.adapters.glsl import SOURCE_TYPE
from encore.adapters.material import RENDER_CONTEXT
from encore.aov import AovDescriptor
from encore.errors import EncoreError, ExitCode, UsageError
from encore.render_buffer import AovBinding, Rectangle, RenderBuffer, pixel_window
from encore.render_pass import ProgressCallback, RenderPass, create_device, load_core, sync
from encore.render_thread import Job, RenderThread
from encore.settings import SETTINGS, resolve

RENDERER_NAME = "Encore"


@dataclass(frozen=True)
class RenderSettingDescriptor:
    """A render setting, as HdRenderSettingDescriptor, with its kind, range and meaning in words."""

    name: str
    key: str
    default_value: Any
    kind: str
    range: str
    doc: str


class RenderDelegate:
    """Settings, device, buffers and passes of a renderer. Types go by Hydra's names.

    The order of a frame is Hydra's too: commit_resources() translates what has changed on the stage,
    create_render_pass().execute() renders it, at once or through start() in the background. settings: by key
    of encore.settings. device: encore._core.Device; None: the one that `select` names is made when needed.
    """

    SUPPORTED_RPRIM_TYPES = ("mesh", "basisCurves", "points")
    SUPPORTED_SPRIM_TYPES = (
        "camera",
        "material",
        "distantLight",
        "rectLight",
        "diskLight",
        "sphereLight",
        "cylinderLight",
        "domeLight",
        "meshLight",
    )
    SUPPORTED_BPRIM_TYPES = ("renderBuffer", "renderSettings", "texture")

    def __init__(
        self,
        settings: Mapping[str, Any] | None = None,
        device: Any = None,
        *,
        select: str = "",
        disable_gpu: bool = False,
        source: str = "",
    ) -> None:
        self._settings = resolve(settings or {})
        self._settings_version = 1
        self._device = device
        self._select, self._disable_gpu = select, disable_gpu
        self._cache: Any = None
        self._source = source
        self._translation: Any = None
        self._bindings: tuple[AovBinding, ...] = ()
        self._window: Rectangle | None = None
        self._statistics: Mapping[str, Any] | None = None
        self.render_thread = RenderThread()

    # What is supported.

    @property
    def material_render_contexts(self) -> tuple[str, ...]:
        """Render contexts whose material outputs are read, the strongest first; empty: the universal one."""
        return (RENDER_CONTEXT, "")

    @property
    def shader_source_types(self) -> tuple[str, ...]:
        """Source types of shaders that are read, besides identifiers of UsdPreviewSurface's nodes."""
        return (SOURCE_TYPE,)

    @staticmethod
    def get_default_aov_descriptor(name: str) -> AovDescriptor:
        """The format and clear value of an AOV. Throws UsageError for a name that is none."""
        return aov.default_descriptor(name)

    # Settings.

    @staticmethod
    def render_setting_descriptors() -> tuple[RenderSettingDescriptor, ...]:
        """Every render setting."""
        return tuple(
            RenderSettingDescriptor(_title(key), key, s.default, s.kind, s.range_text, s.doc)
            for key, s in SETTINGS.items()
        )

    @property
    def render_settings(self) -> dict[str, Any]:
        """All settings by key: a copy."""
        return dict(self._settings)

    @property
    def render_settings_version(self) -> int:
        """Grows with every change of a setting's value."""
        return self._settings_version

    def get_render_setting(self, key: str) -> Any:
        """A setting's value. Throws UsageError for a key that is none."""
        _require_setting(key)
        return self._settings[key]

    def set_render_setting(self, key: str, value: Any) -> None:
        """Changes a setting, from the next frame on; None: back to the default. Throws SettingError.

        What cannot be together with the other settings is refused, and changes nothing.
        """
        self.set_render_settings({key: value})

    def set_render_settings(self, values: Mapping[str, Any]) -> None:
        """Changes several settings at once. Throws SettingError, and changes none then."""
        for key in values:
            _require_setting(key)
        changed = resolve(self._settings | dict(values))
        if changed != self._settings:
            self._settings = changed
            self._settings_version += 1

    # Bprims and passes.

    @property
    def device(self) -> Any:
        """The encore._core.Device. Throws DeviceError where there is none that can be used."""
        if self._device is None:
            self._device = create_device(self._select, self._disable_gpu)
        return self._device

    @property
    def cache(self) -> Any:
        """The encore._core.RenderCache that all passes share."""
        if self._cache is None:
            self._cache = load_core().RenderCache()
        return self._cache

    def create_render_buffer(self, path: str = "") -> RenderBuffer:
        """A buffer without pixels."""
        return RenderBuffer(path)

    def create_render_pass(self) -> RenderPass:
        """A pass on this delegate's device, which shares its cache with all others."""
        return RenderPass(self.device, self.cache, self._source)

    # A frame.

    def commit_resources(self, index: Any, time: Usd.TimeCode) -> Any:
        """Translates what has changed in an encore.render_index.RenderIndex; its Translation.

        Stops the frame that is being rendered. Throws StageError.
        """
        self.stop()
        self._translation = sync(index, time, self._source)
        return self._translation

    def start(self, bindings: Sequence[AovBinding], window: Rectangle | None = None) -> None:
        """Renders what was committed last into buffers, in the background; they are allocated here.

        window: the pixels of the image's plane that are rendered; beyond the image is overscan; None: the
        image. Throws UsageError for AOVs that do not exist, where nothing was committed, and while a frame is
        being rendered, which goes on.
        """
        self.render_thread.start(*self._job(bindings, window))

    def execute(
        self,
        bindings: Sequence[AovBinding],
        window: Rectangle | None = None,
        progress: ProgressCallback | None = None,
    ) -> bool:
        """start() in the calling thread; False where stop() ended it. Throws what rendering throws.

        progress: is asked besides; what it cancels throws Cancelled.
        """
        job, prepare = self._job(bindings, window)
        if progress is None:
            return self.render_thread.run(job, prepare)
        return self.render_thread.run(lambda own: job(lambda *at: own(*at) and progress(*at)), prepare)

    def release(self) -> None:
        """Ends the frame, and lets go of the device, the cache and the scene."""
        self.stop()
        self._translation = self._cache = self._device = None
        self._bindings = ()

    def _job(
        self, bindings: Sequence[AovBinding], window: Rectangle | None
    ) -> tuple[Job, Callable[[], None]]:
        """A frame, and what is to be done before it, when none is being rendered. Changes nothing itself."""
        if self._translation is None:
            raise UsageError("there is nothing to render", "start", "Call commit_resources() first")
        bindings, translation = tuple(bindings), self._translation
        settings = dict(self._settings)
        # Only what is asked for reaches core.
        if asked := aov.requests(bindings):
            settings["aovs"] = asked
        if window is not None:
            settings["window"] = window = pixel_window(window)
        x0, y0, x1, y1 = window or (0, 0, translation.width, translation.height)
        descriptors = [aov.descriptor(binding) for binding in bindings]

        def prepare() -> None:
            for binding, found in zip(bindings, descriptors, strict=True):
                binding.render_buffer.allocate(x1 - x0, y1 - y0, found.format, found.clear_value)
            self._bindings, self._window = bindings, window
            self._statistics = None

        return lambda progress: self._render(bindings, translation, settings, progress), prepare

    def _render(
        self,
        bindings: Sequence[AovBinding],
        translation: Any,
        settings: Mapping[str, Any],
        progress: ProgressCallback,
    ) -> None:
        def take(x0: int, y0: int, images: dict[str, Any]) -> None:
            for binding in bindings:
                binding.render_buffer.add(x0, y0, aov.pixels(binding.aov_name, images))

        self._statistics = self.create_render_pass().execute(translation, settings, take, progress)
        for binding in bindings:
            binding.render_buffer.set_converged()

    @property
    def statistics(self) -> Mapping[str, Any] | None:
        """encore._core.render()'s, of the last frame; None where it is not complete."""
        return self._statistics

    # Control of the frame.

    is_pause_supported = True
    is_stop_supported = True

    def pause(self) -> None:
        """Makes the background frame wait until resume(); it uses no processor meanwhile."""
        self.render_thread.pause()

    def resume(self) -> None:
        """Goes on with a frame that waits; its pixels are what they would have been."""
        self.render_thread.resume()

    def stop(self) -> None:
        """Ends the background frame. Buffers keep what is finished, and are not converged."""
        self.render_thread.stop()

    @property
    def is_stopped(self) -> bool:
        """Whether no frame is being rendered."""
        return not self.render_thread.is_rendering

    def restart(self) -> None:
        """Renders the frame that was started last again, from the beginning, with the settings of now."""
        self.stop()
        self.start(self._bindings, self._window)

    def get_render_stats(self) -> dict[str, Any]:
        """How the frame is doing, by the names that hosts look for.

        percentDone (0 to 100), fractionDone, renderProgressAnnotation (what is at work), totalClockTime
        (seconds, pauses left out), loadClockTime (seconds of dicing and building; 0 before the frame's end),
        peakMemory and totalMemory (bytes of the process, most and now), rendererName, and huskErrorStatus: 0,
        or the exit code of the error that ended the frame (docs/exit_codes.md).
        """
        progress = self.render_thread.progress
        done = 1.0 if self.render_thread.is_converged else min(progress.done, 0.999)
        resident = _resident_bytes()
        times: Mapping[str, float] = (self._statistics or {}).get("time_s", {})
        return {
            "percentDone": 100 * done,
            "fractionDone": done,
            "renderProgressAnnotation": progress.stage,
            "totalClockTime": progress.active_s,
            "loadClockTime": times.get("dice", 0.0) + times.get("build", 0.0),
            # The kernel notes the most only now and then.
            "peakMemory": max(resident, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024),
            "totalMemory": resident,
            "rendererName": RENDERER_NAME,
            "huskErrorStatus": _error_status(self.render_thread.error),
        }


def _title(key: str) -> str:
    """The name of a setting, for people."""
    return key.replace("_", " ").capitalize()


def _require_setting(key: str) -> None:
    if key not in SETTINGS:
        raise UsageError("there is no such setting", key, "docs/settings.md lists them")


def _resident_bytes() -> int:
    """Memory that the process holds now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def _error_status(error: BaseException | None) -> int:
    if error is None:
        return int(ExitCode.OK)
    return int(error.exit_code) if isinstance(error, EncoreError) else int(ExitCode.INTERNAL)
