"""Image files → linear Rec.709 pixels, through OpenImageIO and OpenColorIO."""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio
import PyOpenColorIO as ocio
from pxr import Ar

Pixels = npt.NDArray[np.float32]
HalfPixels = npt.NDArray[np.float16]

HALF_MAX = 65504.0

# The same spaces in every ACES configuration, so a fixed one is used.
_CONFIG = "cg-config-v2.1.0_aces-v1.3_ocio-v2.3"
_SRGB, _LINEAR = "sRGB - Texture", "Linear Rec.709 (sRGB)"
# Pixels that are data, or already in the working space.
_UNCHANGED = ("raw", "data", "identity", "linear", "lin_rec709_scene")
# USD's names of colour spaces (GfColorSpaceNames) → the configuration's.
_USD_SPACES = {
    "sRGB": _SRGB,
    "srgb_rec709_scene": _SRGB,
    "lin_ap0_scene": "ACES2065-1",
    "lin_ap1_scene": "ACEScg",
    "lin_p3d65_scene": "Linear P3-D65",
    "lin_rec2020_scene": "Linear Rec.2020",
    "g18_rec709_scene": "Gamma 1.8 Rec.709 - Texture",
    "g22_rec709_scene": "Gamma 2.2 Rec.709 - Texture",
    "g24_rec709_scene": "Gamma 2.4 Rec.709 - Texture",
    "g22_ap1_scene": "Gamma 2.2 AP1 - Texture",
    "srgb_ap1_scene": "sRGB Encoded AP1 - Texture",
    "srgb_p3d65_scene": "sRGB Encoded P3-D65 - Texture",
}
# USD's name of a wrap mode, by OpenImageIO's as it is found in files.
_WRAP_NAMES = {
    "black": "black",
    "clamp": "clamp",
    "periodic": "repeat",
    "repeat": "repeat",
    "mirror": "mirror",
}
# Files of these formats end with a mark, within this many bytes; that saves reading their pixels to see
# whether they are whole. (Readers of JPEG fill up what is missing without a word.)
_END_MARKS = {"png": b"IEND", "jpeg": b"\xff\xd9"}
_TAIL_BYTES = 65536
_STRIP_ROWS = 64


class TextureError(Exception):
    """Why an image file cannot be read."""


@dataclass(frozen=True)
class ImageHeader:
    """width and height: of the display window. wrap: USD's modes of s and t, as the file's metadata say."""

    width: int
    height: int
    channels: int
    is_8_bit: bool
    wrap: tuple[str, str]


@dataclass(frozen=True)
class Repairs:
    """Pixels that could not be kept: NaN became 0; what half floats cannot hold, their largest number."""

    not_a_number: int = 0
    too_large: int = 0


def read_header(resolved: str) -> ImageHeader:
    """Size and metadata of a file that is whole, as far as its end shows. Raises TextureError."""
    with _opened(resolved) as (source, name):
        spec = source.spec()
        if not _has_end_mark(source, name):
            _read_end(source)
        modes = spec.get_string_attribute("wrapmodes").split(",")
        s, t = (modes * 2)[:2]
        s, t = (spec.get_string_attribute(key) or mode for key, mode in (("wrapS", s), ("wrapT", t)))
        wrap = _WRAP_NAMES.get(s.strip(), "black"), _WRAP_NAMES.get(t.strip(), "black")
        is_8_bit = spec.format.basetype == oiio.UINT8
        return ImageHeader(spec.full_width, spec.full_height, spec.nchannels, is_8_bit, wrap)


def read_pixels(resolved: str, color_space: str) -> Pixels:
    """(height, width, 4) float32, bottom row first, linear; alpha is not multiplied in. Raises TextureError.

    color_space: "raw", "auto" (sRGB for 8-bit images with at least three channels, else raw, as
    UsdPreviewSurface says), or a name that is_color_space() knows. NaN is kept; infinite values too.
    """
    header = read_header(resolved)
    pixels = np.zeros((header.height, header.width, 4), np.float32)
    for first, strip in _strips(resolved, color_space):
        pixels[header.height - first - len(strip) : header.height - first] = strip[::-1]
    return pixels


def read_half_pixels(resolved: str, color_space: str) -> tuple[HalfPixels, Repairs]:
    """read_pixels(), as half floats that are all finite. Raises TextureError.

    Needs little memory beside the result.
    """
    header = read_header(resolved)
    pixels = np.zeros((header.height, header.width, 4), np.float16)
    not_a_number = too_large = 0
    for first, strip in _strips(resolved, color_space):
        if not max(strip.max(), -strip.min()) <= HALF_MAX:
            bad, large = np.isnan(strip), np.abs(strip) > HALF_MAX
            not_a_number += int(np.count_nonzero(bad.any(axis=-1)))
            too_large += int(np.count_nonzero(large.any(axis=-1)))
            strip[bad] = 0
            np.clip(strip, -HALF_MAX, HALF_MAX, out=strip)
        pixels[header.height - first - len(strip) : header.height - first] = strip[::-1]
    return pixels, Repairs(not_a_number, too_large)


def _strips(resolved: str, color_space: str) -> Iterator[tuple[int, Pixels]]:
    """The display window in linear RGBA, some rows (n, width, 4) at a time from the top: first row, pixels.

    Rows without pixels in the file may be left out: they are 0. Raises TextureError.
    """
    with _opened(resolved) as (source, _):
        spec = source.spec()
        if color_space == "auto":
            is_srgb = spec.nchannels >= 3 and spec.format.basetype == oiio.UINT8
            color_space = "sRGB" if is_srgb else "raw"
        processor = _processor(color_space)
        channels = min(spec.nchannels, 4)
        step = (
            math.ceil(_STRIP_ROWS / spec.tile_height) * spec.tile_height if spec.tile_width else _STRIP_ROWS
        )
        for y in range(spec.y, spec.y + spec.height, step):
            end = min(y + step, spec.y + spec.height)
            if spec.tile_width:
                x = spec.x, spec.x + spec.width
                read = source.read_tiles(*x, y, end, 0, 1, 0, channels, oiio.FLOAT)
            else:
                read = source.read_scanlines(y, end, 0, 0, channels, oiio.FLOAT)
            if read is None:
                raise TextureError(source.geterror().strip() or "it is truncated")
            data = np.asarray(read, np.float32).reshape(end - y, spec.width, channels)
            strip = _four_channels(_display_columns(data, spec))
            if processor is not None:
                processor.applyRGBA(strip)
            # Rows above and below of the display window are not seen.
            top = max(0, spec.full_y - y)
            bottom = min(end, spec.full_y + spec.full_height) - y
            if top < bottom:
                yield y + top - spec.full_y, strip[top:bottom]


def is_color_space(name: str) -> bool:
    """Whether pixels can be brought from the colour space to the working space. "auto" is no space."""
    return name in _UNCHANGED or name in _USD_SPACES or _config().getColorSpace(name) is not None


@contextmanager
def _opened(resolved: str) -> Iterator[tuple[oiio.ImageInput, str]]:
    """The file, opened, and its name on disk. Raises TextureError where it holds no pixels."""
    with LocalFile(resolved) as name:
        config = oiio.ImageSpec()
        config.attribute("oiio:UnassociatedAlpha", 1)
        source = oiio.ImageInput.open(name, config)
        if source is None:
            raise TextureError(oiio.geterror().strip() or "unknown format")
        try:
            spec = source.spec()
            if min(spec.width, spec.height, spec.full_width, spec.full_height, spec.nchannels) < 1:
                raise TextureError(f"it has {spec.width} × {spec.height} pixels of {spec.nchannels} channels")
            if spec.depth > 1 or spec.deep:
                raise TextureError("it is a volume or a deep image")
            yield source, name
        finally:
            source.close()


def _has_end_mark(source: oiio.ImageInput, name: str) -> bool:
    """False: that its format has none. Raises TextureError where it has one that is not there."""
    mark = _END_MARKS.get(source.format_name())
    if mark is None:
        return False
    with Path(name).open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _TAIL_BYTES))
        if mark in file.read():
            return True
        # Something long may follow; what comes first may hold the mark of a preview.
        file.seek(min(size, 2 * _TAIL_BYTES))
        if mark in file.read():
            return True
    raise TextureError("it is truncated")


def _read_end(source: oiio.ImageInput) -> None:
    """Reads the last row, and the first one, which some formats put last. Raises TextureError."""
    spec = source.spec()
    end = spec.x + spec.width, spec.y + spec.height
    if spec.tile_width:
        row = spec.y + (spec.height - 1) // spec.tile_height * spec.tile_height
        whole = (
            source.read_tiles(spec.x, end[0], row, end[1], 0, 1, 0, spec.nchannels, oiio.FLOAT) is not None
        )
    else:
        rows = (spec.y, end[1] - 1)
        whole = all(source.read_scanline(y, 0, oiio.FLOAT) is not None for y in rows)
    if not whole:
        raise TextureError(source.geterror().strip() or "it is truncated")


def _display_columns(data: Pixels, spec: Any) -> Pixels:
    """What the display window shows of the columns (rows, width, channels) that are there; else 0."""
    x = spec.x - spec.full_x
    if (x, spec.width) == (0, spec.full_width):
        return data
    window = np.zeros((data.shape[0], spec.full_width, data.shape[2]), np.float32)
    low, high = max(x, 0), min(x + spec.width, spec.full_width)
    if low < high:
        window[:, low:high] = data[:, low - x : high - x]
    return window


def _four_channels(pixels: Pixels) -> Pixels:
    """RGBA. Grey goes into all of RGB; a second channel of two is alpha."""
    height, width, channels = pixels.shape
    result = np.ones((height, width, 4), np.float32)
    if channels <= 2:
        result[..., :3] = pixels[..., :1]
        if channels == 2:
            result[..., 3] = pixels[..., 1]
    else:
        result[..., :channels] = pixels
    return result


@functools.cache
def _config() -> ocio.Config:
    return ocio.Config.CreateFromBuiltinConfig(_CONFIG)


@functools.cache
def _processor(color_space: str) -> ocio.CPUProcessor | None:
    """From a colour space to the working space; None where pixels stay as they are."""
    if color_space in _UNCHANGED:
        return None
    processor = _config().getProcessor(_USD_SPACES.get(color_space, color_space), _LINEAR)
    # The default's approximate powers make white brighter than 1.
    return None if processor.isNoOp() else processor.getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)


class LocalFile:
    """A resolved asset as the name of a file on disk; a temporary one for what lies in a package (USDZ)."""

    def __init__(self, resolved: str) -> None:
        self._resolved = resolved
        self._temporary = ""

    def __enter__(self) -> str:
        if Path(self._resolved).is_file():
            return self._resolved
        asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(self._resolved))
        if not asset:
            raise TextureError("the file does not exist")
        extension = Path(self._resolved.rstrip("]")).suffix
        with asset, tempfile.NamedTemporaryFile(suffix=extension, delete=False) as file:
            file.write(asset.GetBuffer())
            self._temporary = file.name
        return self._temporary

    def __exit__(self, *exception: object) -> None:
        if self._temporary:
            Path(self._temporary).unlink()
