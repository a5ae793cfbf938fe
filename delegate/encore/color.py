"""From scene-linear Rec.709 to the colours of a display, through OpenColorIO."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import PyOpenColorIO as ocio

from encore.errors import UsageError

MODES = ("disabled", "sRGB", "openColorIO")

# sRGB without a tone map: the same in every ACES configuration, so a fixed one is used.
_SRGB_CONFIG = "cg-config-v2.1.0_aces-v1.3_ocio-v2.3"
_SRGB_DISPLAY, _SRGB_VIEW = "sRGB - Display", "Un-tone-mapped"
_LINEAR_REC709 = "Linear Rec.709 (sRGB)"

Transform = Callable[[npt.NDArray[np.float32]], npt.NDArray[np.float32]]


@dataclass(frozen=True)
class ColorOptions:
    """What the flags say. mode: of MODES; empty: openColorIO when another field is given, sRGB otherwise."""

    mode: str = ""
    config: str = ""
    display: str = ""
    view: str = ""

    @property
    def resolved_mode(self) -> str:
        """The mode, with the default resolved. Throws UsageError when flags contradict each other."""
        named = self.config or self.display or self.view
        if named and self.mode not in ("", "openColorIO"):
            raise UsageError(
                f"--ocioConfig, --ocioDisplay and --ocioView have no effect with '{self.mode}'",
                "--colorCorrectionMode",
                "Use openColorIO",
            )
        return self.mode or ("openColorIO" if named else "sRGB")


@dataclass(frozen=True)
class DisplayTransform:
    """apply: (H, W, 3) float32 scene-linear Rec.709 → display values, nominally in [0, 1].

    description goes into the image's metadata.
    """

    apply: Transform
    description: str


def display_transform(options: ColorOptions) -> DisplayTransform:
    """The transform that the options ask for. Throws UsageError that lists what exists."""
    mode = options.resolved_mode
    if mode == "disabled":
        return DisplayTransform(lambda rgb: rgb, "none: scene-linear Rec.709")
    if mode == "sRGB":
        config, source = load_config(_SRGB_CONFIG, "--colorCorrectionMode")
        return _transform(config, source, _SRGB_DISPLAY, _SRGB_VIEW)
    where = "--ocioConfig" if options.config or not os.environ.get("OCIO") else "$OCIO"
    config, source = load_config(options.config or os.environ.get("OCIO", "") or "ocio://default", where)
    display = options.display or config.getDefaultDisplay()
    _require(display, list(config.getDisplays()), "--ocioDisplay", "display", source)
    view = options.view or config.getDefaultView(display)
    _require(view, list(config.getViews(display)), "--ocioView", f"view of display '{display}'", source)
    return _transform(config, source, display, view)


def builtin_configs() -> list[str]:
    """Names of the configurations that come with OpenColorIO."""
    return [str(entry[0]) for entry in ocio.BuiltinConfigRegistry().getBuiltinConfigs()]


def load_config(name: str, where: str) -> tuple[ocio.Config, str]:
    """A configuration and its name: built-in by name, ocio://name, or a file. Throws UsageError."""
    try:
        if name in builtin_configs():
            return ocio.Config.CreateFromBuiltinConfig(name), name
        if not name.startswith("ocio://") and not Path(name).is_file():
            raise UsageError(
                f"'{name}' is neither a file nor a built-in configuration",
                where,
                f"Built-in ones are: {', '.join(builtin_configs())}",
            )
        return ocio.Config.CreateFromFile(name), name
    except ocio.Exception as error:
        raise UsageError(
            f"cannot read the OpenColorIO configuration '{name}': {_first_line(error)}",
            where,
            f"Built-in ones are: {', '.join(builtin_configs())}",
        ) from error


def _transform(config: ocio.Config, name: str, display: str, view: str) -> DisplayTransform:
    try:
        transform = ocio.DisplayViewTransform(src=_working_space(config), display=display, view=view)
        processor = config.getProcessor(transform).getDefaultCPUProcessor()
    except ocio.Exception as error:
        raise UsageError(
            f"'{name}' cannot show linear Rec.709 on '{display}' with '{view}': {_first_line(error)}",
            "--ocioView",
            "Choose another view or configuration",
        ) from error

    def apply(rgb: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        pixels = np.array(rgb, dtype=np.float32, order="C")
        processor.applyRGB(pixels)
        return pixels

    return DisplayTransform(apply, f"{name}: {display}, {view}")


def _working_space(config: ocio.Config) -> str:
    """The configuration's name of linear Rec.709: by a usual name, or as OpenColorIO identifies it."""
    for alias in (_LINEAR_REC709, "lin_rec709_srgb", "lin_rec709", "lin_srgb"):
        if config.getColorSpace(alias) is not None:
            return str(config.getCanonicalName(alias) or alias)
    builtin = ocio.Config.CreateFromBuiltinConfig(_SRGB_CONFIG)
    return str(ocio.Config.IdentifyBuiltinColorSpace(config, builtin, _LINEAR_REC709))


def _require(name: str, existing: list[str], where: str, kind: str, config: str) -> None:
    if name not in existing:
        listed = ", ".join(f"'{e}'" for e in existing)
        raise UsageError(f"'{name}' is no {kind} in '{config}'", where, f"There are: {listed}")


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or ["unknown"])[0]
