"""What the renderer makes of a rectangle of the image → the channels that image files name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from encore.errors import InternalError

# Depth where nothing was hit: finite, so that the file holds no infinities, and beyond every far plane.
EMPTY_DEPTH = np.float32(1e30)

Pixels = npt.NDArray[np.float32]


class Part(NamedTuple):
    """Channels that belong together. pixels: (height, width, len(names)), top row first.

    pixel_type: of the file: float, half or uint; of uint, pixels hold shares of the largest number.
    """

    names: tuple[str, ...]
    pixels: Pixels
    pixel_type: str = "float"


def parts(images: Mapping[str, Any], color_map: Callable[[Pixels], Pixels] | None = None) -> list[Part]:
    """The channels of a rectangle, in the order in which files list them.

    images: what encore._core.render() hands to its tile callback. color_map: what (height, width, 3) radiance
    becomes first; None: nothing else.
    """
    convert = color_map or (lambda pixels: pixels)
    found = [_part("", "RGB", convert(images["composite"])), _part("", "A", images["alpha"])]
    found += [_part(f"{layer}.", "RGB", convert(pixels)) for layer, pixels in images["layers"].items()]
    found.append(_part("", "Z", finite_depth(images)))
    found.append(_part("N.", "XYZ", images["normal"]))
    for layer, debug in images.get("debug", {}).items():
        found += [
            _part(f"{layer}_debug.", (name,), debug[name]) for name in ("evaluations", "reshaded", "distance")
        ]
        found.append(_part(f"{layer}_id.", "RGB", debug["id"]))
    return found


def names(found: Sequence[Part]) -> tuple[str, ...]:
    """All channel names, in order."""
    return tuple(name for part in found for name in part.names)


def pixel_types(found: Sequence[Part]) -> tuple[str, ...]:
    """Of all channels, in order."""
    return tuple(part.pixel_type for part in found for _ in part.names)


def finite_depth(images: Mapping[str, Any]) -> Pixels:
    """(height, width): EMPTY_DEPTH where nothing was hit."""
    depth: Pixels = images["depth"]
    return np.where(np.isposinf(depth), EMPTY_DEPTH, depth)


def require_finite(found: Sequence[Part], x0: int, y0: int) -> None:
    """Throws InternalError that names the first bad channel and pixel. x0, y0: place of the rectangle."""
    for part in found:
        finite = np.isfinite(part.pixels)
        if finite.all():
            continue
        y, x, channel = np.argwhere(~finite)[0].tolist()
        raise InternalError(
            f"channel {part.names[channel]} holds a number that is not finite at pixel ({x0 + x}, {y0 + y}); "
            "the frame is not written",
            remedy="Look for extreme light intensities, and report the stage",
        )


def _part(prefix: str, channels: Sequence[str], pixels: Pixels) -> Part:
    height, width = pixels.shape[:2]
    return Part(tuple(f"{prefix}{name}" for name in channels), pixels.reshape(height, width, len(channels)))
