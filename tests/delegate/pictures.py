"""Images as the renderer hands them over, rectangle by rectangle, and files of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
from encore.color import ColorOptions, display_transform
from encore.image_file import ImageInfo
from encore.image_writer import ImageWriter

Images = dict[str, Any]
Rectangle = tuple[int, int, int, int]
HEADER = {"encore:method": "reuse", "encore:seed": "4294967295", "encore:version": "1.2.3", "comments": "é"}
LAYERS = ("direct", "reflection", "refraction")
DEBUG = ("evaluations", "reshaded", "distance")


def new_images(height: int = 5, width: int = 7, *, debug: bool = False) -> Images:
    """Noise. The composite is the float sum of the layers, as the film's is."""
    random = np.random.default_rng(1)

    def noise(*shape: int) -> npt.NDArray[np.float32]:
        return random.random(shape, dtype=np.float32)

    layers = {
        name: noise(height, width, 3) * np.float32(s) for name, s in zip(LAYERS, (1, 1e-3, 1e3), strict=True)
    }
    made: Images = {
        "layers": layers,
        "composite": (layers["direct"] + layers["reflection"]) + layers["refraction"],
        "alpha": noise(height, width),
        "depth": noise(height, width),
        "normal": noise(height, width, 3) * 2 - 1,
    }
    made["depth"][0, 0] = np.inf
    if debug:
        made["debug"] = {
            layer: {name: noise(height, width) for name in DEBUG} | {"id": noise(height, width, 3)}
            for layer in LAYERS
        }
    return made


def rectangles(width: int, height: int, tile: int, pad: int) -> Iterator[Rectangle]:
    """x0, y0, x1, y1 in the order of the film: tiles, moved back by the filter's reach, up to the borders."""

    def edges(size: int) -> list[int]:
        ends = [end - pad for end in range(tile, size, tile)]
        return [0, *ends, size]

    rows, columns = edges(height), edges(width)
    for y0, y1 in itertools.pairwise(rows):
        for x0, x1 in itertools.pairwise(columns):
            yield x0, y0, x1, y1


def cut(images: Images, rectangle: Rectangle) -> Images:
    """The part of the images in a rectangle, in arrays of its own."""
    x0, y0, x1, y1 = rectangle
    return {
        key: cut(value, rectangle) if isinstance(value, dict) else value[y0:y1, x0:x1].copy()
        for key, value in images.items()
    }


def write(
    path: Path,
    images: Images,
    *,
    tile: int = 64,
    pad: int = 1,
    band_rows: int | None = None,
    color: ColorOptions | None = None,
    **info: Any,
) -> ImageWriter:
    """Writes the images as a render with reuse tiles of this size would. info: more fields of ImageInfo."""
    height, width = images["alpha"].shape
    header = ImageInfo(width, height, band_rows or tile, **{"header": HEADER, **info})
    with ImageWriter(str(path), header, display_transform(color or ColorOptions())) as writer:
        for x0, y0, x1, y1 in rectangles(width, height, tile, pad):
            writer.add(x0, y0, cut(images, (x0, y0, x1, y1)))
    return writer


def read_exr(path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[np.float32]]]:
    """Header and channels, by another library than the one that writes."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: channel.pixels for name, channel in file.channels().items()}
