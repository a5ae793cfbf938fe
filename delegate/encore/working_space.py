"""renderingColorSpace: the linear space in which images are written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import PyOpenColorIO as ocio

from encore.report import Reports

Pixels = npt.NDArray[np.float32]

# One that has all of the spaces below, by the same names in every release.
_CONFIG = "cg-config-v2.1.0_aces-v1.3_ocio-v2.3"
_REC709 = "lin_rec709"
# (x, y) of red, green, blue and white. Rec.709: ITU-R BT.709; Rec.2020: ITU-R BT.2020; P3 with D65: SMPTE EG
# 432-1; AP0 and AP1: SMPTE ST 2065-1 and Academy S-2014-004.
_CHROMATICITIES = {
    _REC709: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    "lin_rec2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "lin_p3d65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
    "lin_ap1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "lin_ap0": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767),
}
# What they are called besides, in lower case; Gf.ColorSpaceNames end in _scene.
_ALIASES = {
    "": _REC709,
    "raw": _REC709,
    "identity": _REC709,
    "lin_srgb": _REC709,
    "lin_rec709_srgb": _REC709,
    "linear rec.709 (srgb)": _REC709,
    "scene_linear": _REC709,
    "linear": _REC709,
    "lin_displayp3": "lin_p3d65",
    "linear p3-d65": "lin_p3d65",
    "linear rec.2020": "lin_rec2020",
    "acescg": "lin_ap1",
    "aces - acescg": "lin_ap1",
    "aces2065-1": "lin_ap0",
    "aces - aces2065-1": "lin_ap0",
}


@dataclass(frozen=True)
class WorkingSpace:
    """A linear space. apply: (h, w, 3) linear Rec.709 → the same in it; None: it is linear Rec.709.

    chromaticities: x and y of red, green, blue and white, as EXR's header has them.
    """

    name: str = _REC709
    chromaticities: tuple[float, ...] = _CHROMATICITIES[_REC709]
    apply: Callable[[Pixels], Pixels] | None = None

    def map(self, pixels: Pixels) -> Pixels:
        return pixels if self.apply is None else self.apply(pixels)


def working_space(name: str, path: str, reports: Reports) -> WorkingSpace:
    """The space that renderingColorSpace names. path: of its prim. What differs from it is reported.

    Colours of the stage are linear Rec.709 for Encore, and so is what it computes with them: only images are
    converted.
    """
    known = name.lower().removesuffix("_scene")
    space = _ALIASES.get(known, known)
    if space not in _CHROMATICITIES:
        reports.error(
            "unknown renderingColorSpace",
            f"renderingColorSpace '{name}' is none of {', '.join(_CHROMATICITIES)}: images stay Rec.709",
            path,
        )
        return WorkingSpace()
    if space == _REC709:
        return WorkingSpace()
    reports.add(
        "renderingColorSpace",
        f"colours are taken and shaded as linear Rec.709, and images are converted to {space}",
        path,
    )
    config = ocio.Config.CreateFromBuiltinConfig(_CONFIG)
    processor = config.getProcessor(_REC709, space).getDefaultCPUProcessor()

    def apply(pixels: Pixels) -> Pixels:
        converted = np.array(pixels, dtype=np.float32, order="C")
        processor.applyRGB(converted)
        return converted

    return WorkingSpace(space, _CHROMATICITIES[space], apply)
