"""EXR files, written while the image is rendered: scanlines, or tiles where rows would be too large."""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
import OpenImageIO as oiio

from encore.channels import Part, Pixels
from encore.image_file import Bands, Cursor, ImageFile, ImageInfo, OiioOutput

# Largest row of rectangles that is held until it is complete, and side of the tiles beyond it.
BAND_BYTES = 256 * 2**20
TILE = 64
# Rows of a chunk of a ZIP-compressed scanline file (OpenEXR File Layout).
_CHUNK_ROWS = 16

_FORMATS = {"float": oiio.FLOAT, "half": oiio.HALF, "uint": oiio.UINT32}

# Primaries and white point of Rec.709 as (x, y) of red, green, blue and white.
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def open_exr(
    path: str, temporary: str, info: ImageInfo, names: Sequence[str], pixel_types: Sequence[str] = ()
) -> ImageFile:
    """A file of 32-bit floats, so that the composite stays exactly the sum of the layers.

    pixel_types: of each channel, where a RenderVar asks for others: float, half or uint.
    """
    spec = oiio.ImageSpec(info.width, info.height, len(names), "float")
    spec.channelnames = tuple(names)
    formats = [_FORMATS[kind] for kind in pixel_types]
    if len(set(formats)) == 1:  # channelformats that are all the same are ignored
        spec.set_format(formats[0])
    else:
        spec.channelformats = tuple(formats)
    spec.x, spec.y = info.x, info.y
    spec.full_width, spec.full_height = info.full_size or (info.width, info.height)
    spec.attribute("compression", "zip")
    spec.attribute("chromaticities", "float[8]", info.chromaticities or REC709)
    spec.attribute("PixelAspectRatio", float(info.pixel_aspect_ratio))
    # Left empty, it is not written. Left out, it would be the time of day.
    spec.attribute("DateTime", "")
    for name, value in info.header.items():
        spec.attribute(name, value)
    tiled = min(info.band_rows, info.height) * info.width * len(names) * 4 > BAND_BYTES
    return (_TiledExr if tiled else _ScanlineExr)(path, temporary, info, spec)


class _ScanlineExr:
    """Rows from the top, written as soon as a row of rectangles is complete."""

    def __init__(self, path: str, temporary: str, info: ImageInfo, spec: oiio.ImageSpec) -> None:
        self._bands = Bands(info, spec.nchannels, np.float32)
        self._output = OiioOutput("openexr", path, temporary, spec)
        self._chunks = -(-info.height // _CHUNK_ROWS)

    def add(self, x0: int, y0: int, found: Sequence[Part]) -> None:
        rows = self._bands.add(x0, y0, [part.pixels for part in found])
        if rows is not None:
            self._output.write_rows(y0, rows)

    def close(self) -> None:
        self._bands.require_end()
        self._output.close()
        _require_whole(self._output, self._chunks, coordinates=1)


class _TiledExr:
    """Tiles in the order in which they become complete.

    Held are parts of tiles only: `_left` at the right edge of the last rectangle, for its rows and those
    above it in its uppermost tiles, and `_above` along the lower edge of the last row of rectangles.
    """

    def __init__(self, path: str, temporary: str, info: ImageInfo, spec: oiio.ImageSpec) -> None:
        spec.tile_width = spec.tile_height = TILE
        # Tiles are then written as they come; in any other order they would be held until it is their turn.
        spec.attribute("openexr:lineOrder", "randomY")
        self._cursor = Cursor(info.width, info.height)
        self._output = OiioOutput("openexr", path, temporary, spec)
        self._width, self._height, self._channels = info.width, info.height, spec.nchannels
        self._chunks = -(-info.width // TILE) * -(-info.height // TILE)
        self._above: Pixels = np.empty((TILE, info.width, spec.nchannels), np.float32)
        self._left: Pixels = np.empty((0, 0, spec.nchannels), np.float32)

    def add(self, x0: int, y0: int, found: Sequence[Part]) -> None:
        rows, columns = found[0].pixels.shape[:2]
        self._cursor.advance(x0, y0, columns, rows)
        x1, y1 = x0 + columns, y0 + rows
        first_x, first_y = _floor(x0), _floor(y0)
        end_x = x1 if x1 == self._width else _floor(x1)
        left = np.empty((y1 - first_y, x1 - end_x, self._channels), np.float32)
        for y in range(first_y, y1, TILE):
            strip = self._strip(x0, y0, min(y + TILE, y1), y, found)
            left[y - first_y :][: len(strip)] = strip[:, end_x - first_x :]
            if y + TILE <= y1 or y1 == self._height:
                if end_x > first_x:
                    self._output.write_tiles(first_x, y, np.ascontiguousarray(strip[:, : end_x - first_x]))
            else:
                self._above[: len(strip), first_x:end_x] = strip[:, : end_x - first_x]
        self._left = left

    def _strip(self, x0: int, y0: int, y1: int, y: int, found: Sequence[Part]) -> Pixels:
        """The pixels that are known of one row of tiles, from y to y1, from the left of the tile of x0."""
        columns = found[0].pixels.shape[1]
        first_x = _floor(x0)
        new_x, new_y = x0 - first_x, max(y0 - y, 0)
        strip = np.empty((y1 - y, new_x + columns, self._channels), np.float32)
        if new_x:
            strip[:, :new_x] = self._left[y - _floor(y0) :][: len(strip)]
        strip[:new_y, new_x:] = self._above[:new_y, x0 : x0 + columns]
        channel = 0
        for part in found:
            end = channel + len(part.names)
            strip[new_y:, new_x:, channel:end] = part.pixels[y + new_y - y0 : y1 - y0]
            channel = end
        return strip

    def close(self) -> None:
        self._cursor.require_end()
        self._output.close()
        _require_whole(self._output, self._chunks, coordinates=4)


def _floor(pixel: int) -> int:
    """Where the tile of a pixel begins."""
    return pixel - pixel % TILE


def _require_whole(output: OiioOutput, chunks: int, *, coordinates: int) -> None:
    """Throws OutputError unless the file's table of chunks is complete and its last chunk ends the file.

    What is written last, closing the file writes without saying whether it could. coordinates: numbers before
    the size of a chunk (OpenEXR File Layout, "Component Five: Scanline Blocks and Tiles").
    """
    with Path(output.temporary).open("rb") as file:
        _skip_header(file)
        table = np.frombuffer(file.read(8 * chunks), "<u8")
        if len(table) == chunks and table.all():
            head = 4 * coordinates + 4
            last = int(table.max())
            file.seek(last + head - 4)
            size = struct.unpack("<i", file.read(4).rjust(4, b"\xff"))[0]
            if size >= 0 and last + head + size == os.fstat(file.fileno()).st_size:
                return
    raise output.fail("the file is incomplete")


def _skip_header(file: BinaryIO) -> None:
    """Moves behind the header of a single-part file: attributes (name, type, size, value), an empty name."""
    file.seek(8)
    while _skip_string(file):
        _skip_string(file)
        file.seek(int.from_bytes(file.read(4), "little"), os.SEEK_CUR)


def _skip_string(file: BinaryIO) -> int:
    """Moves behind a zero; the number of bytes before it."""
    length = 0
    while file.read(1) not in (b"\0", b""):
        length += 1
    return length
