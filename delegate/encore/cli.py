"""The program `encore`: parses the command line, runs a command, turns errors into exit codes."""

from __future__ import annotations

import argparse
import math
import sys
import traceback
from collections.abc import Sequence
from typing import Any, NoReturn

from encore import __version__, color
from encore import progress as progress_module
from encore.errors import EncoreError, ExitCode, UsageError
from encore.settings import GROUPS, SETTINGS, Setting

_GROUP_TITLES = {
    "image": "image",
    "method": "method and quality",
    "reuse": "control of reuse",
    "light": "lights",
    "filter": "pixel filter",
    "geometry": "geometry",
    "machine": "machine",
}
_EPILOG = """exit codes: 0 done, 1 internal error, 2 wrong command line, 3 stage or asset, 4 render setting,
5 device, 6 output, 8 memory, 130 and 143 stopped by SIGINT and SIGTERM (docs/exit_codes.md)."""


class _Parser(argparse.ArgumentParser):
    """Reports errors as EncoreErrors, so that they look and count like all others."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(message, remedy=f"`{self.prog} --help` lists all flags")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; the exit code (docs/exit_codes.md)."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # Known before parsing, because parsing may be what fails.
    verbose = "--verbose" in arguments or "-v" in arguments
    try:
        options = build_parser().parse_args(arguments)
        return int(options.command(options) or ExitCode.OK)
    except EncoreError as error:
        return _fail(str(error), error.exit_code, verbose)
    except KeyboardInterrupt:
        return _fail("stopped by SIGINT", ExitCode.INTERRUPTED, verbose)
    except BrokenPipeError:
        sys.stderr.close()
        return ExitCode.OUTPUT
    except Exception as error:
        text = f"internal error: {type(error).__name__}: {error}. Run again with --verbose and report it"
        return _fail(text, ExitCode.INTERNAL, verbose)


def _fail(text: str, code: int, verbose: bool) -> int:
    if verbose:
        traceback.print_exc()
    print(f"Error: {text}", file=sys.stderr, flush=True)
    return int(code)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = _Parser(prog="encore", description="A shading-reuse renderer for OpenUSD.", allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"encore {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    record = commands.add_parser(
        "record",
        help="render a stage to EXR or PNG, with usdrecord's flags and more",
        description="Renders a USD stage. usdrecord's flags have usdrecord's meaning.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    _add_record_flags(record)
    record.set_defaults(command=_record)

    dump = commands.add_parser(
        "dump",
        help="print what would be rendered, as text",
        description="Translates a stage as record does, and prints the scene that the renderer would get.",
        allow_abbrev=False,
    )
    dump.add_argument("stage", metavar="STAGE", help="USD stage")
    _add_stage_flags(dump)
    _add_time_flags(dump, ranges=False)
    _add_settings(dump, ("image", "geometry"))
    _add_log_flags(dump)
    dump.set_defaults(command=_dump)

    devices = commands.add_parser(
        "devices",
        help="list the Vulkan devices",
        description="Lists the Vulkan devices, with the index and name that --device takes.",
        allow_abbrev=False,
    )
    _add_log_flags(devices)
    devices.set_defaults(command=_devices)
    return parser


def _add_record_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("stage", metavar="STAGE", help="USD stage")
    parser.add_argument(
        "output",
        metavar="OUTPUT",
        help="image to write, .exr or .png; with --frames, its name holds one placeholder: ### or ###.###. "
        "A folder, or - for the current one: render products are written there under their own names",
    )
    _add_stage_flags(parser)
    _add_time_flags(parser, ranges=True)
    for group in GROUPS:
        _add_settings(parser, (group,))
    _add_color_flags(parser)
    _add_machine_flags(parser)
    _add_log_flags(parser)


def _add_stage_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("stage")
    group.add_argument(
        "--mask",
        metavar="PRIMPATH[,PRIMPATH...]",
        default="",
        help="compose only these prims, their descendants and ancestors; commas or spaces separate them",
    )
    group.add_argument(
        "--purposes",
        metavar="PURPOSE[,PURPOSE...]",
        help="purposes to render besides default: render, proxy, guide (default: those of the render "
        "settings, else proxy)",
    )
    group.add_argument(
        "--sessionLayer", metavar="LAYER", default="", help="layer to use as the session layer"
    )
    group.add_argument(
        "--camera",
        "-cam",
        metavar="PRIM",
        default="",
        help="camera, as a prim path or a prim's name (default: that of the render settings, else main_cam, "
        "else the stage's only camera, else one that frames the whole stage)",
    )
    group.add_argument(
        "--disableMotionBlur", action="store_true", help="everything stands still, as at the frame's time"
    )
    group.add_argument(
        "--disableDepthOfField",
        action="store_true",
        help="everything is in focus, whatever the camera's fStop",
    )
    for flag, what in (("--shutterOpen", "opens"), ("--shutterClose", "closes")):
        group.add_argument(
            flag,
            metavar="FRAMES",
            help=f"when the shutter {what}, in frames from the frame's time (default: the camera's "
            f"{flag[2:9]}:{flag[9:].lower()})",
        )
    group.add_argument(
        "--disableCameraLight",
        action="store_false",
        dest="camera_light",
        help="no light at the camera when the stage has no lights",
    )
    group.add_argument(
        "--complexity",
        "-c",
        choices=("low", "medium", "high", "veryhigh"),
        default="low",
        help="refinement: each level above low halves the edges of micropolygons (default: low)",
    )
    group.add_argument(
        "--strict",
        action="store_true",
        help="fail when something of the stage cannot be rendered as it says, instead of reporting it",
    )
    group.add_argument(
        "--renderPassPrimPath",
        "-rp",
        metavar="PRIM",
        default="",
        help="RenderPass to render: its settings, without what it prunes and hides",
    )
    group.add_argument(
        "--renderSettingsPrimPath",
        "-rs",
        metavar="PRIM",
        default="",
        help="RenderSettings to render (default: those that the stage names, if it does); none: flags decide "
        "everything",
    )
    group.add_argument(
        "--disableDrawMode", action="store_true", help="render full geometry in place of any draw mode"
    )
    group.add_argument(
        "--resolver",
        choices=("root", "inherit"),
        default="root",
        help="asset resolver context: that of the stage's file, or that of the environment (default: root)",
    )


def _add_time_flags(parser: argparse.ArgumentParser, *, ranges: bool) -> None:
    group = parser.add_argument_group("time").add_mutually_exclusive_group()
    group.add_argument(
        "--defaultTime",
        "-d",
        action="store_true",
        help="render at the default time (without this and --frames: at the stage's start time)",
    )
    several = (
        "frames: comma-separated FrameSpecs A, A:B or A:BxSTRIDE, such as 1,10:20x2,30:31x0.5; "
        "write --frames=-5:5 when the first is negative"
    )
    group.add_argument(
        "--frames",
        "-f",
        metavar="FRAMESPEC[,FRAMESPEC...]" if ranges else "FRAME",
        help=several if ranges else "the frame",
    )


def _add_settings(parser: argparse.ArgumentParser, names: Sequence[str]) -> None:
    for name in names:
        group = parser.add_argument_group(_GROUP_TITLES[name])
        for setting in GROUPS[name]:
            _add_setting(group, setting)


def _add_setting(group: argparse._ArgumentGroup, setting: Setting) -> None:
    text = setting.doc.replace("`", "").replace("%", "%%")
    if setting.kind == "bool":
        action = "store_false" if setting.default else "store_true"
        group.add_argument(*setting.flags, action=action, default=None, dest=setting.destination, help=text)
        return
    facts = [f"{setting.range_text}".replace("`", "")]
    if setting.unit:
        facts.insert(0, setting.unit)
    group.add_argument(
        *setting.flags,
        dest=setting.destination,
        metavar=setting.metavar,
        help=f"{text} ({'; '.join(facts)}; default: {setting.default_text.replace('`', '')})",
    )


def _add_color_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("colour of PNG images", "EXR images are always scene-linear Rec.709.")
    group.add_argument(
        "--colorCorrectionMode",
        "-color",
        choices=color.MODES,
        default="",
        help="disabled: linear values; sRGB: no tone map; openColorIO: a display and view "
        "(default: sRGB, or openColorIO when a flag below is given)",
    )
    group.add_argument(
        "--ocioConfig",
        metavar="CONFIG",
        default="",
        help="OpenColorIO configuration: a file, ocio://NAME, or a built-in name such as "
        "cg-config-v2.1.0_aces-v1.3_ocio-v2.3 (default: $OCIO, else ocio://default)",
    )
    group.add_argument(
        "--ocioDisplay", metavar="DISPLAY", default="", help="display (default: the configuration's)"
    )
    group.add_argument("--ocioView", metavar="VIEW", default="", help="view (default: the display's)")


def _add_machine_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("device")
    group.add_argument(
        "--device",
        metavar="NAME|INDEX",
        default="",
        help="Vulkan device: part of its name, or its index in `encore devices` (default: $ENCORE_DEVICE, "
        "else a GPU, else the CPU)",
    )
    group.add_argument("--disableGpu", action="store_true", help="use a Vulkan device that runs on the CPU")
    group.add_argument(
        "--renderer", "-r", metavar="NAME", default="Encore", help="renderer plugin; only Encore exists here"
    )


def _add_log_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("output and messages")
    if parser.prog.endswith("record"):
        group.add_argument(
            "--stats", metavar="FILE.json", default="", help="write statistics (docs/usage.md)"
        )
        group.add_argument(
            "--progress",
            choices=progress_module.MODES,
            default="auto",
            help="how progress is shown: auto is a bar on a terminal and lines elsewhere, on standard error; "
            "alf, openjd and json go to standard output (default: auto)",
        )
        group.add_argument("--quiet", "-q", action="store_true", help="print only errors")
        group.add_argument(
            "--traceToFile", metavar="FILE", default="", help="write where USD itself spends its time"
        )
        group.add_argument(
            "--traceFormat",
            choices=("chrome", "trace"),
            default="chrome",
            help="JSON for Chrome's trace viewer, or a report to read (default: chrome)",
        )
    group.add_argument("--verbose", "-v", action="store_true", help="say more; show where errors come from")


def given_settings(options: argparse.Namespace) -> dict[str, Any]:
    """The settings that the flags name, parsed; others are left out. Throws UsageError."""
    given: dict[str, Any] = {}
    for key, setting in SETTINGS.items():
        value = getattr(options, setting.destination, None)
        if value is not None:
            given[key] = setting.parse(value) if isinstance(value, str) else value
    return given


def _frames(text: str | None, flag: str) -> float | None:
    """A time in frames. Throws UsageError for what is no finite number."""
    try:
        value = None if text is None else float(text)
    except ValueError:
        value = math.nan
    if value is not None and not math.isfinite(value):
        raise UsageError(f"'{text}' is not a number of frames", flag)
    return value


def _split_list(text: str) -> tuple[str, ...]:
    return tuple(text.replace(",", " ").split())


def _record_options(options: argparse.Namespace, output: str) -> Any:
    """RecordOptions of the flags that record and dump share."""
    from encore.record import NORMAL, QUIET, VERBOSE, RecordOptions

    quiet = getattr(options, "quiet", False)
    return RecordOptions(
        stage=options.stage,
        output=output,
        settings=given_settings(options),
        mask=_split_list(options.mask),
        purposes=None if options.purposes is None else _split_list(options.purposes),
        session_layer=options.sessionLayer,
        camera=options.camera,
        frames=options.frames,
        default_time=options.defaultTime,
        camera_light=options.camera_light,
        motion_blur=not options.disableMotionBlur,
        depth_of_field=not options.disableDepthOfField,
        shutter_open=_frames(options.shutterOpen, "--shutterOpen"),
        shutter_close=_frames(options.shutterClose, "--shutterClose"),
        complexity=options.complexity,
        strict=options.strict,
        render_settings=options.renderSettingsPrimPath,
        render_pass=options.renderPassPrimPath,
        resolver=options.resolver,
        ignore_draw_modes=options.disableDrawMode,
        trace_file=getattr(options, "traceToFile", ""),
        trace_format=getattr(options, "traceFormat", "chrome"),
        color=color.ColorOptions(
            getattr(options, "colorCorrectionMode", ""),
            getattr(options, "ocioConfig", ""),
            getattr(options, "ocioDisplay", ""),
            getattr(options, "ocioView", ""),
        ),
        device=getattr(options, "device", ""),
        disable_gpu=getattr(options, "disableGpu", False),
        stats=getattr(options, "stats", ""),
        verbosity=QUIET if quiet else VERBOSE if options.verbose else NORMAL,
    )


def _record(options: argparse.Namespace) -> None:
    if options.renderer != "Encore":
        raise UsageError(f"there is no renderer '{options.renderer}' here", "--renderer", "Use Encore")
    if options.quiet and options.verbose:
        raise UsageError("contradicts --verbose", "--quiet", "Leave one of the two out")
    from encore.record import record

    record(
        _record_options(options, options.output),
        progress_module.create(options.progress, 1, quiet=options.quiet),
    )


def _dump(options: argparse.Namespace) -> None:
    from encore.record import dump_text

    print(dump_text(_record_options(options, "")), end="")


def _devices(options: argparse.Namespace) -> None:
    from encore.render_pass import load_core

    devices = load_core().devices()
    for index, info in enumerate(devices):
        kind = "CPU" if info["cpu"] else "GPU"
        print(f"{index}: {info['name']} ({kind}, {info['memory_bytes'] / 2**30:.1f} GiB, {info['driver']})")
    if not devices:
        from encore.errors import DeviceError

        raise DeviceError(
            "there is no Vulkan device", remedy="Install a driver (Debian: mesa-vulkan-drivers)"
        )
