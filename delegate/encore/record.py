"""A run of `encore record`: open the stage, render its frames, write images and statistics."""

from __future__ import annotations

import re
import signal
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdUtils

from encore import __version__, stats
from encore.color import display_transform
from encore.errors import Cancelled, EncoreError, StageError, UsageError
from encore.frame_recorder import FrameRecorder, RenderedFrame
from encore.frames import parse_frame_specs
from encore.output import check_format, check_writable
from encore.progress import Progress
from encore.record_options import NORMAL, QUIET, VERBOSE, RecordOptions, refined, sync_options
from encore.render_delegate import RenderDelegate
from encore.render_pass import create_device, first_line, translate
from encore.render_products import PRODUCT_NAMES, FrameJob, Render, plan_first, plan_run
from encore.report import Reports
from encore.settings import resolve, shader_cache_folder
from encore.trace_file import traced

__all__ = [
    "NORMAL",
    "QUIET",
    "VERBOSE",
    "RecordOptions",
    "dump_text",
    "open_stage",
    "record",
    "refined",
    "sync_options",
]


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
        with (
            StopSignals() as signals,
            UsdDiagnostics(options.verbosity, progress),
            traced(options.trace_file, options.trace_format),
        ):
            _record(options, progress, signals)
    except EncoreError as error:
        progress.fail(str(error))
        raise
    finally:
        progress.close()


def _record(options: RecordOptions, progress: Progress, signals: StopSignals) -> None:
    started = time.perf_counter()
    transform = display_transform(options.color)
    refined(options.complexity, resolve(options.settings))  # what is wrong with flags comes first
    _check_output(options.output)
    stage = open_stage(options)
    reports = Reports()
    jobs = plan_run(options, stage, reports)
    _report_plan(options, reports, progress)
    files = [file.path for job in jobs for render in job.renders for file in render.files]
    for file in (*files, options.stats):
        if file:
            check_writable(file)
    settings = jobs[0].renders[0].settings
    shader_cache_folder(settings["shader_cache"])  # says at once what is wrong with it
    signals.check()

    device = create_device(options.device, options.disable_gpu)
    delegate = RenderDelegate(settings, device, source=options.stage)
    recorder = FrameRecorder(stage, delegate, options.stage, transform)
    run = _Run(options, recorder, progress, signals, time.perf_counter() - started)
    progress.frames = sum(len(job.renders) for job in jobs)
    _say_what_is_ignored(options, settings, files, progress)
    plan_warnings = {report.kind: report.count for report in reports}
    for job in jobs:
        failure = run.frame(job)
        if options.stats and run.entries:
            document = stats.run_statistics(
                run.entries, version=__version__, stage=options.stage, settings=settings, device=device.info
            )
            document["warnings"] = plan_warnings | document["warnings"]
            stats.write(options.stats, document)
        if failure is not None:
            raise failure


def _check_output(output: str) -> None:
    """Throws UsageError for an OUTPUT that is neither a folder, `-`, nor images."""
    if output != PRODUCT_NAMES and not output.endswith("/") and not Path(output).is_dir():
        for name in output.split(",") if not Path(output).suffix else [output]:
            check_format(name)


def _report_plan(options: RecordOptions, reports: Reports, progress: Progress) -> None:
    """Says what of the render settings is not as the stage says. Throws StageError with --strict."""
    if options.strict and reports.has_errors:
        error = reports.errors[0]
        raise StageError(
            f"{error.path}: {error.message}", options.stage, "Repair it, or render without --strict"
        )
    if options.verbosity > QUIET:
        for line in reports.lines():
            progress.message(_as_warning(line))


class _Run:
    """The renders of a run, one after the other. open_s: time to charge to the first as sync."""

    def __init__(
        self,
        options: RecordOptions,
        recorder: FrameRecorder,
        progress: Progress,
        signals: StopSignals,
        open_s: float,
    ) -> None:
        self._options, self._recorder = options, recorder
        self._progress, self._signals = progress, signals
        self._open_s = open_s
        self._number = 0
        self.entries: list[dict[str, Any]] = []  # of the statistics

    def frame(self, job: FrameJob) -> BaseException | None:
        """Renders and writes a frame. One render that fails does not stop the others: the first failure."""
        failure: BaseException | None = None
        said: set[str] = set()
        for render in job.renders:
            self._progress.begin_frame(self._number, job.label)
            self._number += 1
            try:
                failed = self._render(job, render, said)
            except Cancelled:
                raise Cancelled(self._signals.number or signal.SIGINT) from None
            except EncoreError as error:
                failed = error
            if failed is not None and failure is not None:
                self._progress.message(f"Warning: {failed}")
            failure = failure or failed
        return failure

    def _render(self, job: FrameJob, render: Render, said: set[str]) -> BaseException | None:
        """Renders and writes; what has kept a file of it from being written. said: lines of the frame."""
        started = time.perf_counter()

        def advance(done: float, stage_name: str) -> bool:
            self._progress.update(done, stage_name)
            return not self._signals.number

        rendered = self._recorder.render(job.time, job.label, render, advance)
        options = self._options
        warnings = _report(options, rendered, self._progress, said)
        if options.strict and rendered.reports.has_errors:
            # Found while rendering, such as pixels of a texture: what sync found has ended the run before.
            error = rendered.reports.errors[0]
            raise StageError(
                f"{error.path}: {error.message}", options.stage, "Repair it, or render without --strict"
            )
        entry = stats.frame_statistics(
            rendered.statistics,
            frame=job.label,
            output=", ".join(rendered.written),
            camera=rendered.camera,
            sync_s=self._open_s + rendered.sync_s,
            write_s=rendered.write_s,
            total_s=self._open_s + time.perf_counter() - started,
            warnings=warnings,
        )
        self._open_s = 0.0
        self.entries.append(entry | _used(render, rendered))
        for file in rendered.written:
            self._progress.written(file)
        return rendered.failure


def _used(render: Render, rendered: RenderedFrame) -> dict[str, Any]:
    """What statistics say of how a frame was asked for."""
    width, height = rendered.size
    return {
        "outputs": [
            {"file": file.path, "product": file.product}
            for file in render.files
            if file.path in rendered.written
        ],
        "resolution": [width, height],
        "data_window": list(render.window or (0, 0, width, height)),
        "render_settings": {name.removeprefix("encore:"): value for name, value in render.source.items()},
        "settings": {**render.settings, "width": width, "height": height},
    }


def dump_text(options: RecordOptions) -> str:
    """The translated scene of the first frame as text, for `encore dump`. Throws EncoreError."""
    from encore.dump import dump

    stage = open_stage(options)
    time_code = Usd.TimeCode(stage.GetStartTimeCode())
    if options.default_time:
        time_code = Usd.TimeCode.Default()
    if options.frames is not None:
        times, _ = parse_frame_specs(options.frames)
        if len(times) != 1:
            raise UsageError(f"'{options.frames}' is not one frame", "--frames", "Give a single one")
        time_code = Usd.TimeCode(times[0])
    reports = Reports()
    render = plan_first(options, stage, time_code, reports)
    translation = translate(stage, time_code, render.sync_options(), options.stage)
    return str(dump(translation)) + "".join(f"report {line}\n" for line in reports.lines())


def open_stage(options: RecordOptions) -> Usd.Stage:
    """Opens the stage with its session layer and population mask, as usdrecord does. Throws StageError."""
    root = open_layer(options.stage)
    session = open_layer(options.session_layer) if options.session_layer else Sdf.Layer.CreateAnonymous()
    resolver = Ar.GetResolver()
    if options.resolver == "inherit":
        context = resolver.CreateDefaultContext()
    else:
        context = resolver.CreateDefaultContextForAsset(options.stage)
    try:
        if not options.mask:
            return Usd.Stage.Open(root, session, context)
        mask = Usd.StagePopulationMask()
        for path in options.mask:
            if not is_prim_path(path):
                raise UsageError(f"'{path}' is not an absolute prim path", "--mask", "Write /World/Group")
            mask.Add(path)
        for path in _render_prims(options, root, session):
            mask.Add(path)
        return Usd.Stage.OpenMasked(root, session, context, mask)
    except Tf.ErrorException as error:
        raise StageError(f"the stage cannot be opened: {first_line(error)}", options.stage) from error


def _render_prims(options: RecordOptions, root: Sdf.Layer, session: Sdf.Layer) -> set[str]:
    """What a mask must not hide of render settings: all of /Render where they are below it, else they."""
    named = [options.render_settings, options.render_pass]
    if not any(named):
        named = [layer.pseudoRoot.GetInfo("renderSettingsPrimPath") for layer in (session, root)]
    paths = (path for path in named if path and is_prim_path(path))
    return {"/Render" if Sdf.Path(path).HasPrefix("/Render") else path for path in paths}


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


def _say_what_is_ignored(
    options: RecordOptions, settings: Mapping[str, Any], files: Sequence[str], progress: Progress
) -> None:
    if options.verbosity == QUIET:
        return
    formats = {Path(file).suffix.lower() for file in files}
    named_color = options.color.mode not in ("", "disabled") or options.color.resolved_mode == "openColorIO"
    if named_color and ".exr" in formats:
        progress.message("Warning: --colorCorrectionMode: EXR stays scene-linear; only PNG is corrected.")
    if settings["debug_aovs"] and ".png" in formats:
        progress.message("Warning: --debugAovs: PNG holds only the composite; only EXR has room for them.")


def _report(
    options: RecordOptions, rendered: RenderedFrame, progress: Progress, said: set[str]
) -> dict[str, int]:
    """Prints what differs from what the stage says; message → count. said: lines that need no repetition."""
    warnings = dict(rendered.statistics["warnings"])
    reports = [r for r in rendered.reports if not (options.ignore_draw_modes and r.kind == "draw mode")]
    if options.verbosity > QUIET:
        for report in reports:
            line = _as_warning(report.line())
            if line not in said:
                said.add(line)
                progress.message(line)
        for text, count in warnings.items():
            progress.message(f"Warning: {options.stage}: {text} ({count} times).")
    warnings |= {report.kind: report.count for report in reports}
    if options.verbosity >= VERBOSE:
        statistics = rendered.statistics
        times = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in statistics["time_s"].items())
        progress.message(f"Camera: {rendered.camera or 'automatic'}")
        progress.message(f"Device: {statistics['device']} ({statistics['driver']})")
        progress.message(f"Seconds: sync {rendered.sync_s:.2f}, {times}")
    return warnings


def _as_warning(line: str) -> str:
    """A report's line. "Error:" at the start of a line means a failed run, to people and to farms."""
    return re.sub("^Error:", "Warning:", line)
