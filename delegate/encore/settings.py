"""The render settings: one table that drives the flags, docs/settings.md and what core is given.

Keys are the field names of core/scene/settings.h, and so are the defaults; a test compares them.
"""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from encore.errors import OutputError, SettingError, UsageError

_SIZE_UNITS = {"": 1, "b": 1}
for _power, _letter in enumerate("kmgt", start=1):
    _SIZE_UNITS |= {_letter: 1024**_power, f"{_letter}ib": 1024**_power, f"{_letter}b": 1000**_power}


_INT32_MAX = 2**31 - 1
# Size is UsdRender's own business, and these two are the machine's.
_NOT_OF_STAGES = frozenset({"width", "height", "shader_cache", "threads"})


@dataclass(frozen=True)
class Setting:
    """One render setting.

    key: field of core's Settings. flags: of the command line, the long one first; that of a bool which is on
    switches it off. default: None where the stage decides. default_says: for documentation, instead. minimum
    and maximum: both allowed; None: no bound, beyond what the type holds.
    """

    key: str
    flags: tuple[str, ...]
    kind: str  # int, float, bool, size, choice or text
    default: Any
    doc: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None  # a bound that is itself not allowed
    multiple_of: int | None = None
    choices: tuple[str, ...] = ()
    metavar: str = ""
    default_says: str = ""

    @property
    def flag(self) -> str:
        """The long flag."""
        return self.flags[0]

    @property
    def attribute(self) -> str:
        """The attribute of a RenderSettings or RenderProduct prim that says it; empty where none does."""
        if self.key in _NOT_OF_STAGES:
            return ""
        words = self.key.split("_") if self.kind == "bool" else [self.flag.removeprefix("--")]
        return f"encore:{words[0]}" + "".join(word.capitalize() for word in words[1:])

    @property
    def usd_type_name(self) -> str:
        """The attribute's type. Whole numbers that may be large are 64 bits wide."""
        if self.kind == "int":
            return "int64" if self.maximum is None or self.maximum > _INT32_MAX else "int"
        return {"size": "int64", "choice": "token"}.get(self.kind, self.kind)

    @property
    def destination(self) -> str:
        """Attribute name in argparse's namespace."""
        return f"setting_{self.key}"

    def parse(self, text: str) -> Any:
        """The value that the text of a flag means. Throws UsageError when it means none."""
        readers: dict[str, Callable[[str], Any]] = {"int": int, "float": float, "size": parse_size}
        try:
            return readers[self.kind](text) if self.kind in readers else text
        except ValueError:
            article = {"int": "a whole number", "float": "a number", "size": "a size such as 512M or 2GiB"}
            raise UsageError(f"'{text}' is not {article[self.kind]}", self.flag) from None

    def check(self, value: Any) -> None:
        """Throws SettingError that names the flag, the value and the range."""
        if self.kind == "choice" and value not in self.choices:
            raise UsageError(
                f"'{value}' is not a choice", self.flag, f"Choose one of: {', '.join(self.choices)}"
            )
        if self.kind not in ("int", "float", "size") or value is None:
            return
        bad = not math.isfinite(value)
        bad |= self.minimum is not None and value < self.minimum
        bad |= self.maximum is not None and value > self.maximum
        bad |= self.above is not None and value <= self.above
        bad |= bool(self.multiple_of and value % self.multiple_of)
        if bad:
            raise SettingError(f"{value} is out of range", self.flag, f"It must be {self.range_text}")

    @property
    def range_text(self) -> str:
        """The range in words, for messages and documentation."""
        if self.kind == "choice":
            return " or ".join(f"`{c}`" for c in self.choices)
        if self.kind == "bool":
            return "off when given" if self.default else "on when given"
        if self.kind == "text":
            return "a folder, or `none`"
        parts = []
        if self.above is not None:
            parts.append(f"above {self.above:g}")
        if self.minimum is not None:
            parts.append(f"at least {_number(self.minimum)}")
        if self.maximum is not None:
            parts.append(f"at most {_number(self.maximum)}")
        if self.multiple_of:
            parts.append(f"a multiple of {self.multiple_of}")
        return ", ".join(parts) or "finite"

    @property
    def default_text(self) -> str:
        """The default in words, for help and documentation."""
        if self.default_says:
            return self.default_says
        if self.default is None:
            return "from the camera"
        if self.kind == "bool":
            return "on" if self.default else "off"
        return _number(self.default) if isinstance(self.default, (int, float)) else str(self.default)


_UINT32_MAX = 2**32 - 1

GROUPS: dict[str, tuple[Setting, ...]] = {
    "image": (
        Setting(
            "width",
            ("--imageWidth", "-w"),
            "int",
            960,
            "Width of the image.",
            unit="pixels",
            minimum=1,
            maximum=65536,
            metavar="PIXELS",
        ),
        Setting(
            "height",
            ("--imageHeight",),
            "int",
            None,
            "Height of the image; without it, the width and the camera's aspect ratio decide.",
            unit="pixels",
            minimum=1,
            maximum=65536,
            metavar="PIXELS",
        ),
        Setting(
            "dome_light_visible",
            ("--enableDomeLightVisibility",),
            "bool",
            False,
            "The camera sees dome lights as the background. Reflections and refractions always see them.",
        ),
        Setting(
            "lights_visible",
            ("--enableLightVisibility",),
            "bool",
            False,
            "The camera sees lights that have a size. Reflections and refractions always see them.",
        ),
    ),
    "method": (
        Setting(
            "method",
            ("--method",),
            "choice",
            "reuse",
            "How shading is spent: `reuse` shades few points and reuses the nearest one (the product). To "
            "compare with: `reference` shades every antialiasing sample; `decoupled` and `decoupled-pixel` "
            "share shading among samples of equal hash; `vertex` shades the vertices of micropolygons.",
            choices=("reuse", "reference", "decoupled", "decoupled-pixel", "vertex"),
            metavar="METHOD",
        ),
        Setting(
            "samples",
            ("--samples",),
            "int",
            8,
            "Antialiasing samples: N × N per pixel.",
            unit="per pixel side",
            minimum=1,
            maximum=64,
            metavar="N",
        ),
        Setting(
            "shading_rate",
            ("--shadingRate",),
            "float",
            2.0,
            "Shading samples per pixel per layer, on average. (RenderMan's shading rate is its inverse: "
            "pixels per shading sample.) Not used by `--method reference`. Prims and instances may have "
            "rates of their own.",
            unit="per pixel per layer",
            above=0,
            maximum=256,
            metavar="X",
        ),
        Setting(
            "shading_rate_reflection",
            ("--shadingRateReflection",),
            "float",
            0.0,
            "The same for the reflection layer alone. 0: as `--shadingRate`.",
            unit="per pixel",
            minimum=0,
            maximum=256,
            metavar="X",
        ),
        Setting(
            "shading_rate_refraction",
            ("--shadingRateRefraction",),
            "float",
            0.0,
            "The same for the refraction layer alone. 0: as `--shadingRate`.",
            unit="per pixel",
            minimum=0,
            maximum=256,
            metavar="X",
        ),
        Setting(
            "max_bounces",
            ("--maxBounces",),
            "int",
            4,
            "Mirror, glossy and refractive bounces after the first hit; 0 leaves only the direct layer.",
            unit="bounces",
            minimum=0,
            maximum=256,
            metavar="N",
        ),
        Setting(
            "roughness_limit",
            ("--roughnessLimit",),
            "float",
            0.3,
            "Reflections of interfaces up to this roughness are traced and get a layer of their own; those "
            "of rougher ones are evaluated under the lights as part of shading. Refraction is always traced.",
            unit="UsdPreviewSurface roughness",
            minimum=0,
            maximum=1,
            metavar="X",
        ),
        Setting(
            "reuse_tile_pixels",
            ("--reuseTile",),
            "int",
            512,
            "Side of the squares within which shading is reused. Recorded, because it changes pixels.",
            unit="pixels",
            minimum=16,
            maximum=65536,
            multiple_of=16,
            metavar="PIXELS",
        ),
        Setting(
            "seed",
            ("--seed",),
            "int",
            0,
            "Seed of all random numbers. Equal seeds give equal pixels, bit for bit.",
            minimum=0,
            maximum=_UINT32_MAX,
            metavar="N",
        ),
    ),
    "reuse": (
        Setting(
            "search",
            ("--search",),
            "choice",
            "auto",
            "How the nearest shading samples are found: `tree` (the paper's kd-trees), `groups` (candidates "
            "shared by the samples of a pixel) or `cells` (lists per cell of a grid); never changes a pixel. "
            "`auto` chooses per layer.",
            choices=("auto", "tree", "groups", "cells"),
            metavar="SEARCH",
        ),
        Setting(
            "footprint_reuse",
            ("--footprintReuse",),
            "choice",
            "ignore",
            "What the footprints of two samples have to do with reuse between them. `ignore`: nothing. "
            "`metric`: unlike footprints add to the distance (the paper's §2.4; needs `--search` `auto` or "
            "`tree`). `octaves`: samples whose footprints are of different octaves never share.",
            choices=("ignore", "metric", "octaves"),
            metavar="MODE",
        ),
        Setting(
            "footprint_weight",
            ("--footprintWeight",),
            "float",
            1.0,
            "Weight of unlike footprints in `--footprintReuse metric` (the paper's c).",
            above=0,
            maximum=1e6,
            metavar="X",
        ),
        Setting(
            "reuse_time_weight",
            ("--reuseTimeWeight",),
            "float",
            0.0,
            "Weight of time in the distance between samples, where things move: that of a whole shutter "
            "interval. 0: time is not part of it. Needs `--search` `auto` or `tree`.",
            unit="parameters of the primitive",
            minimum=0,
            maximum=1e6,
            metavar="X",
        ),
        Setting(
            "reuse_direction_weight",
            ("--reuseDirectionWeight",),
            "float",
            0.0,
            "Weight of the direction from which a path arrives in the distance between samples, as a unit "
            "vector. 0: it is not part of it. Needs `--search` `auto` or `tree`.",
            unit="parameters of the primitive",
            minimum=0,
            maximum=1e6,
            metavar="X",
        ),
        Setting(
            "max_reuse_distance",
            ("--maxReuseDistance",),
            "float",
            0.0,
            "Farthest that shading is reused; beyond it a sample is shaded itself. 0: no limit.",
            unit="spacings of shading samples",
            minimum=0,
            maximum=1e6,
            metavar="X",
        ),
        Setting(
            "world_space_parameters",
            ("--worldSpaceParameters",),
            "bool",
            False,
            "Distances between samples are measured in parameters that are scaled to each primitive's "
            "extents in the world, so that a long thin face does not reuse along its length.",
        ),
        Setting(
            "debug_aovs",
            ("--debugAovs",),
            "bool",
            False,
            "EXR images also hold, per layer, how shading was spent: evaluations, reshaded share, distance "
            "of reuse, and samples in false colours.",
        ),
    ),
    "light": (
        Setting(
            "light_samples",
            ("--lightSamples",),
            "int",
            16,
            "Shadow rays per light with an extent, each time a point is shaded. Lights with `encore:samples` "
            "have their own number.",
            unit="rays per light and shade",
            minimum=1,
            maximum=65536,
            metavar="N",
        ),
        Setting(
            "occlusion_samples",
            ("--occlusionSamples",),
            "int",
            64,
            "Occlusion rays per dome light, each time a point is shaded. Domes with `encore:samples` have "
            "their own number.",
            unit="rays per dome and shade",
            minimum=1,
            maximum=65536,
            metavar="N",
        ),
        Setting(
            "most_light_samples",
            ("--mostLightSamples",),
            "int",
            128,
            "Shadow rays to all lights with an extent, each time a point is shaded. Where all lights "
            "together ask for more, lights are chosen by importance.",
            unit="rays per shade",
            minimum=1,
            maximum=2**20,
            metavar="N",
        ),
        Setting(
            "occlusion_distance_world",
            ("--occlusionDistance",),
            "float",
            0.0,
            "Farthest that surfaces occlude dome lights. 0: any distance.",
            unit="world units",
            minimum=0,
            metavar="X",
        ),
        Setting(
            "glass_shadows",
            ("--glassShadows",),
            "choice",
            "transmit",
            "What transparent bodies do to light on its way to a surface. `transmit`: it passes straight, "
            "less what their interfaces reflect and what is opaque in them. `opaque`: it does not pass.",
            choices=("transmit", "opaque"),
            metavar="MODE",
        ),
        Setting(
            "energy_compensation",
            ("--disableEnergyCompensation",),
            "bool",
            True,
            "Rough lobes get back the light that microfacets reflect among each other; without it rough "
            "metal is too dark.",
        ),
    ),
    "filter": (
        Setting(
            "filter",
            ("--filter",),
            "choice",
            "blackman-harris",
            "Reconstruction filter of the pixels.",
            choices=("box", "gaussian", "mitchell", "blackman-harris"),
            metavar="FILTER",
        ),
        Setting(
            "filter_radius_pixels",
            ("--filterRadius",),
            "float",
            1.5,
            "Distance from the pixel's centre at which the filter ends, along each axis. `box` usually wants "
            "0.5.",
            unit="pixels",
            minimum=0.5,
            maximum=8,
            metavar="X",
        ),
    ),
    "geometry": (
        Setting(
            "target_edge_length_world",
            ("--targetEdgeLength",),
            "float",
            0.0,
            "Longest edge of the micropolygons that subdivision surfaces are diced into, for meshes without "
            "`primvars:encore:targetEdgeLength`. 0: from the size of each mesh and of the scene, never from "
            "the camera.",
            unit="world units",
            minimum=0,
            metavar="X",
        ),
        Setting(
            "edge_length_scale",
            ("--edgeLengthScale",),
            "float",
            1.0,
            "Factor on the edge length of meshes without `primvars:encore:targetEdgeLength`. Every level of "
            "`--complexity` above low halves it.",
            minimum=1e-3,
            maximum=1e3,
            metavar="X",
        ),
        Setting(
            "max_micropolygons",
            ("--maxMicropolygons",),
            "int",
            100_000_000,
            "Most micropolygons that dicing may make; beyond it the frame ends with an error instead of "
            "exhausting the machine.",
            unit="micropolygons",
            minimum=1,
            maximum=10_000_000_000,
            metavar="N",
        ),
    ),
    "machine": (
        Setting(
            "memory_budget_bytes",
            ("--memory",),
            "size",
            0,
            "Memory for samples, trees and film; never changes a pixel. Geometry and textures are not part "
            "of it. K, M, G, T and KiB, MiB, … count in 1024s; KB, MB, … in 1000s. 0: half of the device's; "
            "on a CPU device half of what is free.",
            unit="bytes",
            minimum=0,
            metavar="SIZE",
        ),
        Setting(
            "texture_budget_bytes",
            ("--textureMemory",),
            "size",
            0,
            "Memory for textures: only the levels of detail that are needed are kept. 0: an eighth of the "
            "machine's memory.",
            unit="bytes",
            minimum=0,
            metavar="SIZE",
        ),
        Setting(
            "shader_cache",
            ("--shaderCache",),
            "text",
            "",
            "Folder of compiled pattern shaders, by content; never changes a pixel, and is not recorded in "
            "images. `none`: they are compiled every time.",
            metavar="FOLDER",
            default_says="`encore` in `$XDG_CACHE_HOME`, else in `~/.cache`",
        ),
        Setting(
            "threads",
            ("--threads",),
            "int",
            0,
            "CPU threads; never changes a pixel. 0: all.",
            unit="threads",
            minimum=0,
            maximum=1024,
            metavar="N",
        ),
    ),
}

SETTINGS: dict[str, Setting] = {s.key: s for group in GROUPS.values() for s in group}
# Those that prims of the stage may say (EncoreRenderSettingsAPI), by the name of their attribute.
STAGE_SETTINGS: dict[str, Setting] = {s.attribute: s for s in SETTINGS.values() if s.attribute}


def _number(value: float) -> str:
    """A number as people write it: no exponent and no needless fraction."""
    return str(int(value)) if float(value).is_integer() else f"{value:g}"


def parse_size(text: str) -> int:
    """Bytes that `text` means, such as 64M, 1.5GiB, 512MB or 1000000. Throws ValueError."""
    match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]*)?)\s*([A-Za-z]*)\s*", text)
    if not match or match[2].lower() not in _SIZE_UNITS:
        raise ValueError(f"not a size: {text!r}")
    return int(float(match[1]) * _SIZE_UNITS[match[2].lower()])


def resolve(given: Mapping[str, Any]) -> dict[str, Any]:
    """All settings: the given ones (None: not given) over the defaults, checked.

    height stays None unless given: the camera decides it. Throws SettingError or UsageError.
    """
    values: dict[str, Any] = {}
    for key, setting in SETTINGS.items():
        value = given.get(key)
        values[key] = setting.default if value is None else value
        setting.check(values[key])
    _check_together(values)
    return values


def _check_together(values: Mapping[str, Any]) -> None:
    """Throws SettingError for values that are in range each, but contradict each other."""
    if values["footprint_reuse"] == "metric" and values["search"] not in ("auto", "tree"):
        raise SettingError(
            f"'{values['search']}' does not know the footprint metric",
            SETTINGS["search"].flag,
            "With --footprintReuse metric, choose auto or tree",
        )
    for key in ("reuse_time_weight", "reuse_direction_weight"):
        if values[key] > 0 and values["search"] not in ("auto", "tree"):
            raise SettingError(
                f"'{values['search']}' does not know time and direction",
                SETTINGS["search"].flag,
                f"With {SETTINGS[key].flag}, choose auto or tree",
            )


def shader_cache_folder(setting: str) -> str:
    """The folder that `--shaderCache` means, made if need be; empty: none. setting: empty without the flag.

    Where the default one cannot be made there is none. Throws OutputError for a given one that cannot.
    """
    if setting == "none":
        return ""
    given = bool(setting)
    home = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(home) if Path(home).is_absolute() else Path("~/.cache")
    try:
        folder = (Path(setting) if given else base / "encore").expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except (OSError, RuntimeError) as error:
        if not given:
            return ""
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(
            f"cannot be used as a shader cache ({reason})", setting, "Name another folder, or none"
        ) from error
    return str(folder.resolve())
