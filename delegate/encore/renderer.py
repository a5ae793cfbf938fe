"""The Python interface: open a stage, render, edit, render again, get arrays. docs/python.md has examples."""

from __future__ import annotations

import math
import os
import re
import time as clock
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from difflib import get_close_matches
from types import TracebackType
from typing import Any, TypeAlias

from pxr import Usd

from encore.aov import descriptor, requests
from encore.errors import Cancelled, EncoreError, StageError, UsageError
from encore.frames import parse_frame_specs
from encore.image_file import ImageInfo
from encore.image_header import header
from encore.record import open_stage
from encore.record_options import COMPLEXITIES, RecordOptions
from encore.render_buffer import AovBinding, Array, Rectangle, RenderBuffer, pixel_window
from encore.render_delegate import RenderDelegate
from encore.render_index import RenderIndex, SyncCounts, SyncOptions
from encore.render_products import Render, plan_first, settled_settings
from encore.render_result import RenderResult
from encore.render_thread import RenderProgress
from encore.report import Reports
from encore.settings import SETTINGS
from encore.stats import frame_statistics

# Names of AOVs, or names and what is asked of them, such as {"color": {}, "primvars:st": {"components": 2}}.
Aovs: TypeAlias = Sequence[str] | Mapping[str, Mapping[str, Any]]
Time: TypeAlias = float | Usd.TimeCode | None

# Opening options that the command line calls otherwise.
_OPTIONS = {
    "--camera": "camera",
    "--mask": "mask",
    "--purposes": "purposes",
    "--sessionLayer": "session_layer",
    "--shutterOpen": "shutter_open",
    "--shutterClose": "shutter_close",
    "--device": "device",
    "--disableGpu": "disable_gpu",
    "--frames": "frames",
    "--strict": "strict",
    "--renderSettingsPrimPath": "render_settings",
}
_NAMES = {setting.flag: key for key, setting in SETTINGS.items()} | _OPTIONS


class Renderer:
    """Renders a stage, again and again; between frames only what has changed is translated and built anew.

    stage: a file, or an open Usd.Stage, which is rendered as it is at the time of the call. Options mean what
    the flags of `encore record` mean (docs/usage.md); mask and session_layer are for files only. All other
    keywords are settings by name (docs/settings.md). What is not given is as the stage's RenderSettings say,
    of which the first product is rendered. Throws StageError, UsageError and SettingError.

    One thread at a time may call its methods, and must not edit the stage meanwhile; progress, buffers,
    pause(), resume(), stop() and wait() are free to all threads. While a frame is rendered in the background
    the stage may be edited: the frame shows it as it was at start(). Renderers do not disturb each other.
    """

    def __init__(
        self,
        stage: str | os.PathLike[str] | Usd.Stage,
        *,
        camera: str = "",
        purposes: Sequence[str] | None = None,
        mask: Sequence[str] = (),
        session_layer: str | os.PathLike[str] = "",
        camera_light: bool = True,
        motion_blur: bool = True,
        depth_of_field: bool = True,
        shutter_open: float | None = None,
        shutter_close: float | None = None,
        complexity: str = "low",
        render_settings: str = "",
        strict: bool = False,
        device: str = "",
        disable_gpu: bool = False,
        **settings: Any,
    ) -> None:
        with _names_of_python():
            self._options = RecordOptions(
                stage="" if isinstance(stage, Usd.Stage) else os.fspath(stage),
                output="",
                mask=tuple(mask),
                settings=_known(settings),
                purposes=None if purposes is None else tuple(purposes),
                session_layer=os.fspath(session_layer),
                camera=camera,
                camera_light=camera_light,
                motion_blur=motion_blur,
                depth_of_field=depth_of_field,
                shutter_open=shutter_open,
                shutter_close=shutter_close,
                complexity=complexity,
                render_settings=render_settings,
                strict=strict,
                device=device,
                disable_gpu=disable_gpu,
            )
            if complexity not in COMPLEXITIES:
                known = ", ".join(COMPLEXITIES)
                raise UsageError(f"{complexity!r} is none", "complexity", f"There are {known}")
            if isinstance(stage, Usd.Stage) and (mask or session_layer):
                raise UsageError("an open stage has its own", "mask, session_layer", "Open it with them")
            self.stage = stage if isinstance(stage, Usd.Stage) else open_stage(self._options)
            self.source = self._options.stage or str(self.stage.GetRootLayer().identifier)
            self.delegate = RenderDelegate(
                self._plan(None)[0].settings, select=device, disable_gpu=disable_gpu, source=self.source
            )
        self._index: RenderIndex | None = RenderIndex(self.stage)
        self._buffers: dict[str, RenderBuffer] = {}
        self._frame: _Frame | None = None

    # Settings and options.

    @property
    def settings(self) -> MutableMapping[str, Any]:
        """The settings by name; assigning changes them from the next frame on. Throws SettingError."""
        return _Settings(self)

    def set(self, **settings: Any) -> None:
        """Changes several settings at once, all or none. None: what the stage or the default says.

        Throws SettingError.
        """
        given = {**self._options.settings, **_known(settings)}
        options = replace(self._options, settings={k: v for k, v in given.items() if v is not None})
        with _names_of_python():
            settled_settings(options, {})
        self._options = options

    @property
    def camera(self) -> str:
        """Path or name of the camera of the next frame; empty: as `encore record` chooses."""
        return self._options.camera

    @camera.setter
    def camera(self, camera: str) -> None:
        self._options = replace(self._options, camera=camera)

    # Frames.

    def render(
        self,
        time: Time = None,
        aovs: Aovs = ("color",),
        window: Rectangle | None = None,
        progress: Callable[[float, str], bool] | None = None,
    ) -> RenderResult:
        """Renders the stage as it is now, and returns when all is done.

        time: a time code; None: the stage's first. aovs: docs/python.md lists them. window: the pixels
        (x0, y0, x1, y1) of the image to render, y down; they may lie beyond it. progress: called now and then
        with the share that is done and what is at work; False cancels. Throws EncoreError; Cancelled where
        progress or stop() has ended it.
        """
        with _names_of_python():
            bindings, window = self._commit(time, aovs, window)
            self.delegate.execute(bindings, window, progress)
        result = self.wait()
        if result is None:
            raise Cancelled
        return result

    def render_frames(self, frames: str | Iterable[Time], aovs: Aovs = ("color",)) -> Iterator[RenderResult]:
        """Renders several times, one result each. frames: time codes, or a FrameSpec such as "1:24x2"."""
        with _names_of_python():
            times = parse_frame_specs(frames)[0] if isinstance(frames, str) else frames
        for time in times:
            yield self.render(time, aovs)

    def start(self, time: Time = None, aovs: Aovs = ("color",), window: Rectangle | None = None) -> None:
        """render() in the background: returns as soon as the stage is translated. A frame before is stopped.

        Throws EncoreError for what is wrong with stage, settings and AOVs; the rest is thrown by wait().
        """
        with _names_of_python():
            self.delegate.start(*self._commit(time, aovs, window))

    def wait(self, timeout: float | None = None) -> RenderResult | None:
        """Waits for the frame's end: what it has rendered, or None where stop() has ended it.

        timeout: in seconds; then TimeoutError. Throws what rendering throws, and UsageError without a frame.
        """
        frame = self._frame
        if frame is None:
            raise UsageError("nothing has been started", "wait", "Call start() first")
        with _names_of_python():
            complete = self.delegate.render_thread.wait(timeout)
            # Another thread may have started the next frame, which has stopped this one.
            return frame.result() if complete and frame is self._frame else None

    def pause(self) -> None:
        """Makes the background frame wait until resume(). It uses no processor, and pixels stay the same."""
        self.delegate.pause()

    def resume(self) -> None:
        """Ends the pause."""
        self.delegate.resume()

    def stop(self) -> None:
        """Ends the background frame. Buffers keep what is finished, and do not converge."""
        self.delegate.stop()

    @property
    def is_rendering(self) -> bool:
        """Whether a frame is being rendered, paused ones included."""
        return not self.delegate.is_stopped

    @property
    def progress(self) -> RenderProgress:
        """How far the frame is."""
        return self.delegate.render_thread.progress

    @property
    def buffers(self) -> Mapping[str, RenderBuffer]:
        """The buffers of the frame that was started last, by AOV. Every frame has new ones."""
        return dict(self._buffers)

    @property
    def last_sync(self) -> SyncCounts:
        """What the last frame's translation has read of the stage; the rest was known already."""
        return self._require_open().last_sync

    @property
    def last_made(self) -> Mapping[str, int]:
        """How many things the last frame has made anew, by kind; the rest was kept from frames before.

        meshes (diced), prototypes (structures to trace rays in), programs and kernels (of materials),
        textures and light_images (read).
        """
        self._require_open()
        made: Mapping[str, int] = self.delegate.cache.made
        return made

    # Lifetime.

    def close(self) -> None:
        """Stops the frame, and lets go of the device and of all that was kept between frames."""
        self.delegate.stop()
        self.delegate.release()
        if self._index is not None:
            self._index.change_tracker.close()
        self._index = self._frame = None
        self._buffers = {}

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _require_open(self) -> RenderIndex:
        if self._index is None:
            raise UsageError("it is closed", self.source, "Make a new Renderer")
        return self._index

    def _plan(self, time: Time) -> tuple[Render, Reports]:
        """What options, settings and the stage's RenderSettings come to, and what of the latter does not."""
        reports = Reports()
        render = plan_first(self._options, self.stage, _time_code(time, self.stage), reports)
        if self._options.strict and reports.has_errors:
            error = reports.errors[0]
            raise StageError(f"{error.path}: {error.message}", self.source, "Repair it, or do not be strict")
        return render, reports

    def _commit(
        self, time: Time, aovs: Aovs, window: Rectangle | None
    ) -> tuple[list[AovBinding], Rectangle | None]:
        """Translates the stage; bindings to new buffers, and the pixels to render."""
        started = clock.perf_counter()
        index = self._require_open()
        asked = aovs if isinstance(aovs, Mapping) else {name: {} for name in aovs}
        if isinstance(aovs, str) or not asked:
            raise UsageError(f"{aovs!r} is no sequence of names", "aovs", 'Write ("color", "depth")')
        buffers = {name: self.delegate.create_render_buffer(name) for name in asked}
        bindings = [AovBinding(name, buffers[name], settings=asked[name]) for name in asked]
        for binding in bindings:
            descriptor(binding)  # says what is wrong with it
        window = None if window is None else pixel_window(window)
        code = _time_code(time, self.stage)
        primvars = tuple((a["primvar"], a["components"]) for a in requests(bindings) if "primvar" in a)
        self.delegate.stop()
        self._frame = None
        render, reports = self._plan(code)
        self.delegate.set_render_settings(render.settings)
        options = SyncOptions(**{**render.sync_options(), "aov_primvars": primvars})
        if options != index.options:
            index.options = options
        translation = self.delegate.commit_resources(index, code)
        window = window or render.window
        sync_s = clock.perf_counter() - started
        self._buffers = buffers
        self._frame = _Frame(self, render, code, translation, window, reports, sync_s)
        return bindings, window


class _Frame:
    """A frame that was started: what its result is made of when it is complete."""

    def __init__(
        self,
        renderer: Renderer,
        render: Render,
        time: Usd.TimeCode,
        translation: Any,
        window: Rectangle | None,
        reports: Reports,
        sync_s: float,
    ) -> None:
        self._delegate, self._source = renderer.delegate, renderer.source
        self._buffers = renderer.buffers
        self._render, self._time, self._translation = render, time, translation
        self._window = window or (0, 0, translation.width, translation.height)
        self._reports, self._sync_s = reports, sync_s
        self._result: RenderResult | None = None

    def result(self) -> RenderResult:
        """Throws StageError where it is to be strict and what was read while rendering is broken."""
        if self._result is None:
            self._result = self._make()
        return self._result

    def _make(self) -> RenderResult:
        translation = self._translation
        if self._render.sync["strict"] and translation.reports.has_errors:
            error = translation.reports.errors[0]
            raise StageError(f"{error.path}: {error.message}", self._source, "Repair it, or do not be strict")
        reports = (*self._reports, *translation.reports)
        core = self._delegate.statistics
        assert core is not None  # the frame is complete
        statistics = frame_statistics(
            core,
            frame=_label(self._time),
            output="",
            camera=translation.camera_path,
            sync_s=self._sync_s,
            write_s=0.0,
            total_s=self._sync_s + self._delegate.render_thread.progress.active_s,
            warnings={report.kind: report.count for report in reports},
        )
        arrays = {name: _pixels(buffer) for name, buffer in self._buffers.items()}
        return RenderResult(arrays, self._time, statistics, reports, self._info())

    def _info(self) -> ImageInfo:
        """Of the files that the frame is saved to."""
        found, (x0, y0, x1, y1) = self._translation, self._window
        size = found.width, found.height
        settings = {**self._render.settings, "width": size[0], "height": size[1]}
        texts = {
            **header(settings, found, self._delegate.device, self._source, _label(self._time)),
            **self._render.source,
        }
        if self._window != (0, 0, *size):
            texts["encore:dataWindow"] = f"{x0} {y0} {x1} {y1}"
        rows = y1 - y0
        return ImageInfo(x1 - x0, rows, rows, texts, found.pixel_aspect_ratio, x0, y0, size)


def _label(time: Usd.TimeCode) -> str:
    """What headers and statistics call a frame."""
    return "default" if time.IsDefault() else f"{time.GetValue():g}"


def _pixels(buffer: RenderBuffer) -> Array:
    """What a converged buffer holds, for good: the next frame has other buffers."""
    with buffer.mapped() as pixels:
        return pixels


class _Settings(MutableMapping[str, Any]):
    """A renderer's settings as a dictionary of fixed keys: those of the stage's first time code."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer

    def __getitem__(self, key: str) -> Any:
        with _names_of_python():
            return self._renderer._plan(None)[0].settings[key]

    def __setitem__(self, key: str, value: Any) -> None:
        if key not in SETTINGS:
            raise UsageError("there is no such setting", key, "docs/settings.md lists them")
        self._renderer.set(**{key: value})

    def __delitem__(self, key: str) -> None:
        """Back to what the stage or the default says."""
        self[key] = None

    def __iter__(self) -> Iterator[str]:
        return iter(SETTINGS)

    def __len__(self) -> int:
        return len(SETTINGS)

    def __repr__(self) -> str:
        return repr(dict(self))


def _known(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """The settings. Throws TypeError, as Python does of keywords, for a name that is none."""
    for name in settings:
        if name not in SETTINGS:
            near = get_close_matches(name, [*SETTINGS, *_OPTIONS.values()], 1)
            raise TypeError(f"there is no setting {name!r}{f': do you mean {near[0]!r}?' if near else ''}")
    return settings


def _time_code(time: Time, stage: Usd.Stage) -> Usd.TimeCode:
    """The time code of a frame. Throws UsageError for what is none: NaN would mean the default time."""
    if time is None:
        return Usd.TimeCode(stage.GetStartTimeCode())
    if isinstance(time, Usd.TimeCode) and time.IsDefault():
        return time
    try:
        finite = math.isfinite(time.GetValue() if isinstance(time, Usd.TimeCode) else time)
    except (TypeError, OverflowError):
        finite = False
    if not finite:
        raise UsageError(f"{time!r} is no time code", "time", "Give a finite number, a Usd.TimeCode, or None")
    return time if isinstance(time, Usd.TimeCode) else Usd.TimeCode(float(time))


@contextmanager
def _names_of_python() -> Iterator[None]:
    """Errors inside call settings and options as Python does, and not by their flags."""
    try:
        yield
    except Cancelled:
        raise
    except EncoreError as error:
        was = [error.what, error.where, error.remedy]
        texts = [re.sub(r"--[A-Za-z]+", lambda flag: _NAMES.get(flag[0], flag[0]), text) for text in was]
        if texts == was:
            raise
        raise type(error)(*texts) from error
