"""What the writers of all image formats share: what a file says, and rectangles → rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from encore.channels import Part
from encore.errors import InternalError, OutputError


@dataclass(frozen=True)
class ImageInfo:
    """Shape and header of an image. band_rows: rows that a row of rectangles has at most, for planning.

    width, height: of the pixels that there are. x, y: where the first of them is in the whole image, whose
    size is full_size (None: there are no others). chromaticities: of linear colours, as EXR has them (None:
    Rec.709).
    """

    width: int
    height: int
    band_rows: int
    header: Mapping[str, str] = field(default_factory=dict)
    pixel_aspect_ratio: float = 1.0
    x: int = 0
    y: int = 0
    full_size: tuple[int, int] | None = None
    chromaticities: tuple[float, ...] | None = None


class ImageFile(Protocol):
    """A file that is open for writing; rectangles come in the order that Cursor asks for."""

    def add(self, x0: int, y0: int, found: Sequence[Part]) -> None:
        """Takes a rectangle, whose upper left pixel is (x0, y0). Throws OutputError."""

    def close(self) -> None:
        """Ends a file that has all of its pixels. Throws OutputError unless it is whole on disk."""


class Cursor:
    """Follows rectangles over the image: rows of one height from the top, in a row from the left."""

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height
        self._x = self._y = self._rows = 0

    def advance(self, x0: int, y0: int, width: int, height: int) -> bool:
        """Takes the next rectangle; True where it ends its row. Throws InternalError if it is not next."""
        expected = (self._x, self._y, height if self._x == 0 else self._rows)
        fits = x0 + width <= self._width and y0 + height <= self._height
        if (x0, y0, height) != expected or not fits:
            raise InternalError(
                f"rectangle {width} x {height} at ({x0}, {y0}) of the image came out of order"
            )
        self._x, self._rows = self._x + width, height
        if self._x < self._width:
            return False
        self._x, self._y = 0, self._y + height
        return True

    def require_end(self) -> None:
        """Throws InternalError unless the image is covered."""
        if (self._x, self._y) != (0, self._height):
            raise InternalError(f"the image ends at ({self._x}, {self._y})")


class Bands:
    """Puts rectangles side by side until they are rows of the image. dtype: of a channel."""

    def __init__(self, info: ImageInfo, channels: int, dtype: npt.DTypeLike) -> None:
        self._cursor = Cursor(info.width, info.height)
        self._width, self._channels, self._dtype = info.width, channels, dtype
        self._band: npt.NDArray[Any] = np.empty((0, info.width, channels), dtype)

    def add(self, x0: int, y0: int, pixels: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any] | None:
        """Takes a rectangle, in arrays (height, width, n) with all channels in order.

        The rows from y0 on when they are complete: (rows, width, channels), valid until the next call.
        """
        height, width = pixels[0].shape[:2]
        complete = self._cursor.advance(x0, y0, width, height)
        if len(self._band) != height:
            self._band = np.empty((height, self._width, self._channels), self._dtype)
        first = 0
        for part in pixels:
            end = first + part.shape[2]
            self._band[:, x0 : x0 + width, first:end] = part
            first = end
        return self._band if complete else None

    def require_end(self) -> None:
        """Throws InternalError unless all rows were complete."""
        self._cursor.require_end()


def limit_threads(count: int) -> None:
    """How many threads OpenImageIO and OpenEXR compress with, in this process. 0: all."""
    for name in ("threads", "exr_threads"):
        oiio.attribute(name, count)


class OiioOutput:
    """An OpenImageIO output whose failures are OutputErrors. path: for messages; temporary: where it is.

    It is opened when there is something to write: libpng complains of a file that is closed without pixels.
    """

    def __init__(self, format_name: str, path: str, temporary: str, spec: oiio.ImageSpec) -> None:
        self.path, self.temporary = path, temporary
        self._spec = spec
        self._is_open = False
        file = oiio.ImageOutput.create(format_name)
        if file is None:
            raise self.fail(oiio.geterror())
        self._file = file

    def write_rows(self, y: int, pixels: npt.NDArray[Any]) -> None:
        """pixels: (rows, width, channels). y: from the first row that there is."""
        self._open()
        y += self._spec.y
        self._require(self._file.write_scanlines(y, y + len(pixels), 0, pixels))

    def write_tiles(self, x: int, y: int, pixels: npt.NDArray[Any]) -> None:
        """Whole tiles, or up to the image's border. pixels: (rows, columns, channels), contiguous."""
        self._open()
        x, y = x + self._spec.x, y + self._spec.y
        rows, columns = pixels.shape[:2]
        self._require(self._file.write_tiles(x, x + columns, y, y + rows, 0, 1, pixels))

    def close(self) -> None:
        self._require(self._file.close())

    def fail(self, why: str) -> OutputError:
        """The error to raise for a file that cannot be written."""
        return OutputError(f"cannot be written ({why})", self.path, "Free some space or choose another place")

    def _open(self) -> None:
        if not self._is_open:
            self._is_open = True
            self._require(self._file.open(self.temporary, self._spec))

    def _require(self, done: bool) -> None:
        if not done:
            raise self.fail(self._file.geterror())
