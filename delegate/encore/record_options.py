"""What the flags of `encore record` say, and what follows from them for settings and translation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pxr import UsdGeom

from encore.adapters.camera import ShutterOptions
from encore.color import ColorOptions
from encore.errors import SettingError, UsageError
from encore.settings import SETTINGS, resolve

QUIET, NORMAL, VERBOSE = 0, 1, 2

# Each level halves the edges of the last, as each of usdrecord's refines once more.
COMPLEXITIES = {"low": 0, "medium": 1, "high": 2, "veryhigh": 3}

# usdrecord's, besides default.
DEFAULT_PURPOSES = ("proxy",)


@dataclass(frozen=True)
class RecordOptions:
    """What the flags say; docs/usage.md explains them. settings: by key of encore.settings, None: default.

    purposes: None where no flag names any. render_settings: path of a prim, `none`, or empty where the stage
    decides. ignore_draw_modes: they are not to be spoken of. trace_file, trace_format: of encore.trace_file.
    """

    stage: str
    output: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    mask: tuple[str, ...] = ()
    purposes: tuple[str, ...] | None = None
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
    render_settings: str = ""
    render_pass: str = ""
    resolver: str = "root"
    ignore_draw_modes: bool = False
    trace_file: str = ""
    trace_format: str = "chrome"
    stats: str = ""
    verbosity: int = NORMAL


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
    purposes = DEFAULT_PURPOSES if options.purposes is None else options.purposes
    for purpose in purposes:
        if purpose not in known:
            raise UsageError(f"'{purpose}' is no purpose", "--purposes", f"There are: {', '.join(known)}")
    return {
        "camera": options.camera,
        "purposes": tuple(dict.fromkeys(("default", *purposes))),
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


def given_flags(options: RecordOptions) -> list[str]:
    """Flags that were given and decide what an image looks like, in alphabetical order."""
    given = {
        "--camera": options.camera,
        "--complexity": options.complexity != RecordOptions.complexity,
        "--disableCameraLight": not options.camera_light,
        "--disableDepthOfField": not options.depth_of_field,
        "--disableMotionBlur": not options.motion_blur,
        "--mask": options.mask,
        "--purposes": options.purposes is not None,
        "--shutterClose": options.shutter_close is not None,
        "--shutterOpen": options.shutter_open is not None,
    }
    return sorted(
        [flag for flag, is_given in given.items() if is_given] + [SETTINGS[k].flag for k in options.settings]
    )
