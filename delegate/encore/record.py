"""A run of `encore record`: open the stage, render its frames, write images and statistics."""

from __future__ import annotations

import re
import signal
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdUtils

from encore import __version__, stats
from encore.adapters.camera import ShutterOptions
from encore.color import ColorOptions, DisplayTransform, display_transform
from encore.errors import Cancelled, EncoreError, SettingError, StageError, UsageError
from encore.frames import Frame, parse_frame_specs, plan
from encore.output import check_format, check_writable
from encore.progress import Progress
from encore.render_pass import RenderedFrame, RenderPass, create_device, first_line, translate
from encore.settings import resolve, shader_cache_folder

QUIET, NORMAL, VERBOSE = 0, 1, 2

# Each level halves the edges of the last, as each of usdrecord's refines once more.
COMPLEXITIES = {"low": 0, "medium": 1, "high": 2, "veryhigh": 3}


@dataclass(frozen=True)
class RecordOptions:
    """What the flags say; docs/usage.md explains them. settings: by key of encore.settings, None: default."""

    stage: str
    output: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    mask: tuple[str, ...] = ()
    purposes: tuple[str, ...] = ("proxy",)
    session_layer: str = ""
    camera: str = ""
    frames: str | None = None
    default_time: bool = False
    camera_light: bool = True
    motion_blur: bool = True
    depth_of_field: bool = True
    shutter_open: float | None = None
    shutter_close: float | None = None
    complexity: str = "low"
    color: ColorOptions = field(default_factory=ColorOptions)
    device: str = ""
    disable_gpu: bool = False
    strict: bool = False
    stats: str = ""
    verbosity: int = NORMAL


class StopSignals:
    """While active, SIGINT and SIGTERM are noted instead of ending the process; a second SIGINT ends it."""

    def __init__(self) -> None:
        self.number = 0
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> StopSignals:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Throws Cancelled if a signal has come."""
        if self.number:
            raise Cancelled(self.number)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.number = self.number or number
        signal.signal(signal.SIGINT, signal.SIG_DFL)


class UsdDiagnostics:
    """While active, what USD says of the stage is kept; at the end one line per kind of it is printed.

    Composition errors are left out: the translation reports them with their prims.
    """

    def __init__(self, verbosity: int, progress: Progress) -> None:
        self._verbosity = verbosity
        self._progress = progress
        self._delegate: Any = None

    def __enter__(self) -> UsdDiagnostics:
        if self._verbosity < VERBOSE:
            self._delegate = UsdUtils.CoalescingDiagnosticDelegate()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._delegate is None:
            return
        for item in self._delegate.TakeCoalescedDiagnostics():
            if self._verbosity == QUIET or "_ReportErrors" in item.sharedItem.sourceFunction:
                continue
            first, count = item.unsharedItems[0].commentary, len(item.unsharedItems)
            self._progress.message(f"Warning: USD: {first.strip()}{f' ({count} times)' if count > 1 else ''}")
        self._delegate = None


def record(options: RecordOptions, progress: Progress) -> None:
    """Renders every frame and writes it; stops at the first that fails. Throws EncoreError."""
    try:
        with StopSignals() as signals, UsdDiagnostics(options.verbosity, progress):
            _record(options, progress, signals)
    except EncoreError as error:
        progress.fail(str(error))
        raise
    finally:
        progress.close()


def _record(options: RecordOptions, progress: Progress, signals: StopSignals) -> None:
    settings = refined(options.complexity, resolve(options.settings))
    transform = display_transform(options.color)
    check_format(options.output)
    started = time.perf_counter()
    stage = open_stage(options)
    frames = plan(stage, options.output, options.frames, options.default_time)
    for file in (*(frame.output for frame in frames), options.stats):
        if file:
            check_writable(file)
    translation_options = sync_options(options, settings)
    shader_cache_folder(settings["shader_cache"])  # says at once what is wrong with it
    signals.check()

    device = create_device(options.device, options.disable_gpu)
    open_s = time.perf_counter() - started
    render_pass = RenderPass(stage, settings, device, translation_options, options.stage)
    progress.frames = len(frames)
    _say_what_is_ignored(options, stage, frames, progress)
    entries: list[dict[str, Any]] = []
    for index, frame in enumerate(frames):
        progress.begin_frame(index, frame.label)
        entry = _record_frame(options, render_pass, transform, frame, open_s, progress, signals)
        open_s = 0.0
        entries.append(entry)
        progress.written(frame.output)
        if options.stats:
            document = stats.run_statistics(
                entries, version=__version__, stage=options.stage, settings=settings, device=device.info
            )
            stats.write(options.stats, document)


def _record_frame(
    options: RecordOptions,
    render_pass: RenderPass,
    transform: DisplayTransform,
    frame: Frame,
    open_s: float,
    progress: Progress,
    signals: StopSignals,
) -> dict[str, Any]:
    """Renders and writes one frame; its entry of the statistics. open_s: time to charge to it as sync."""
    started = time.perf_counter()

    def advance(done: float, stage_name: str) -> bool:
        progress.update(done, stage_name)
        return not signals.number

    try:
        rendered = render_pass.render(frame.time, frame.label, frame.output, transform, advance)
    except Cancelled:
        raise Cancelled(signals.number or signal.SIGINT) from None
    warnings = _report(options, rendered, progress)
    if options.strict and rendered.reports.has_errors:
        # Found while rendering, such as pixels of a texture: what sync found has ended the run before.
        error = rendered.reports.errors[0]
        raise StageError(
            f"{error.path}: {error.message}", options.stage, "Repair it, or render without --strict"
        )
    return stats.frame_statistics(
        rendered.statistics,
        frame=frame.label,
        output=frame.output,
        camera=rendered.camera,
        sync_s=open_s + rendered.sync_s,
        write_s=rendered.write_s,
        total_s=open_s + time.perf_counter() - started,
        warnings=warnings,
    )


def dump_text(options: RecordOptions) -> str:
    """The translated scene of the first frame as text, for `encore dump`. Throws EncoreError."""
    from encore.dump import dump

    settings = refined(options.complexity, resolve(options.settings))
    stage = open_stage(options)
    time_code = Usd.TimeCode(stage.GetStartTimeCode())
    if options.default_time:
        time_code = Usd.TimeCode.Default()
    if options.frames is not None:
        times, _ = parse_frame_specs(options.frames)
        if len(times) != 1:
            raise UsageError(f"'{options.frames}' is not one frame", "--frames", "Give a single one")
        time_code = Usd.TimeCode(times[0])
    translation = translate(stage, time_code, sync_options(options, settings), options.stage)
    return str(dump(translation))


def open_stage(options: RecordOptions) -> Usd.Stage:
    """Opens the stage with its session layer and population mask, as usdrecord does. Throws StageError."""
    root = open_layer(options.stage)
    session = open_layer(options.session_layer) if options.session_layer else Sdf.Layer.CreateAnonymous()
    context = Ar.GetResolver().CreateDefaultContextForAsset(options.stage)
    try:
        if not options.mask:
            return Usd.Stage.Open(root, session, context)
        mask = Usd.StagePopulationMask()
        for path in options.mask:
            if not is_prim_path(path):
                raise UsageError(f"'{path}' is not an absolute prim path", "--mask", "Write /World/Group")
            mask.Add(path)
        return Usd.Stage.OpenMasked(root, session, context, mask)
    except Tf.ErrorException as error:
        raise StageError(f"the stage cannot be opened: {first_line(error)}", options.stage) from error


def is_prim_path(text: str) -> bool:
    """Whether the text is the absolute path of a prim."""
    return bool(Sdf.Path.IsValidPathString(text)) and text.startswith("/") and Sdf.Path(text).IsPrimPath()


def open_layer(path: str) -> Sdf.Layer:
    """Opens a layer. Throws StageError that tells a missing file from an unreadable one."""
    if not Ar.GetResolver().Resolve(path):
        raise StageError(
            "there is no such stage", path, "Check the name and the asset resolver's search path"
        )
    try:
        layer = Sdf.Layer.FindOrOpen(path)
    except Tf.ErrorException as error:
        raise StageError(
            f"cannot be read: {first_line(error)}", path, "Check it with usdcat or usdchecker"
        ) from error
    if not layer:
        raise StageError("is no USD file that can be read", path, "Check it with usdcat or usdchecker")
    return layer


def sync_options(options: RecordOptions, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The part of the options that the translation needs, as keyword arguments of SyncOptions."""
    known = UsdGeom.Imageable.GetOrderedPurposeTokens()
    opens, closes = options.shutter_open, options.shutter_close
    if opens is not None and closes is not None and closes < opens:
        raise SettingError(
            f"the shutter closes at {closes:g}, before it opens at {opens:g}",
            "--shutterClose",
            "Give a time at or after --shutterOpen",
        )
    for purpose in options.purposes:
        if purpose not in known:
            raise UsageError(f"'{purpose}' is no purpose", "--purposes", f"There are: {', '.join(known)}")
    return {
        "camera": options.camera,
        "purposes": tuple(dict.fromkeys(("default", *options.purposes))),
        "width": settings["width"],
        "height": settings["height"],
        "camera_light": options.camera_light,
        "strict": options.strict,
        "shutter": ShutterOptions(options.motion_blur, options.shutter_open, options.shutter_close),
        "depth_of_field": options.depth_of_field,
    }


def refined(complexity: str, settings: dict[str, Any]) -> dict[str, Any]:
    """The settings with edges halved once per level of complexity above low. Throws SettingError."""
    scale = settings["edge_length_scale"] / 2 ** COMPLEXITIES[complexity]
    return resolve(settings | {"edge_length_scale": scale})


def _say_what_is_ignored(
    options: RecordOptions, stage: Usd.Stage, frames: list[Frame], progress: Progress
) -> None:
    if options.verbosity == QUIET:
        return
    if stage.GetMetadata("renderSettingsPrimPath"):
        progress.message(
            f"Warning: {options.stage}: it names render settings "
            f"({stage.GetMetadata('renderSettingsPrimPath')}), which are not supported yet. Flags decide."
        )
    named_color = options.color.mode not in ("", "disabled") or options.color.resolved_mode == "openColorIO"
    if named_color and any(Path(frame.output).suffix.lower() == ".exr" for frame in frames):
        progress.message("Warning: --colorCorrectionMode: EXR stays scene-linear; only PNG is corrected.")
    if options.settings.get("debug_aovs") and any(Path(f.output).suffix.lower() == ".png" for f in frames):
        progress.message("Warning: --debugAovs: PNG holds only the composite; only EXR has room for them.")


def _report(options: RecordOptions, rendered: RenderedFrame, progress: Progress) -> dict[str, int]:
    """Prints what differs from what the stage says; message → count."""
    warnings = dict(rendered.statistics["warnings"])
    if options.verbosity > QUIET:
        for line in rendered.reports.lines():
            # "Error:" at the start of a line means a failed run, to people and to farms.
            progress.message(re.sub("^Error:", "Warning:", line))
        for text, count in warnings.items():
            progress.message(f"Warning: {options.stage}: {text} ({count} times).")
    warnings |= {report.kind: report.count for report in rendered.reports}
    if options.verbosity >= VERBOSE:
        statistics = rendered.statistics
        times = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in statistics["time_s"].items())
        progress.message(f"Camera: {rendered.camera or 'automatic'}")
        progress.message(f"Device: {statistics['device']} ({statistics['driver']})")
        progress.message(f"Seconds: sync {rendered.sync_s:.2f}, {times}")
    return warnings
