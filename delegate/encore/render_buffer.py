"""Buffers that a frame's AOVs are rendered into, in the shape of Hydra's render buffers."""

from __future__ import annotations

import enum
import operator
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from encore.errors import MemoryLimitError, UsageError

Array = npt.NDArray[Any]
# x0, y0, x1, y1 in pixels; x1 and y1 are not part of it.
Rectangle = tuple[int, int, int, int]


def pixel_window(window: Any) -> Rectangle:
    """The rectangle that is asked for: four whole numbers of 32 bit. Throws UsageError."""
    try:
        x0, y0, x1, y1 = map(operator.index, window)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{window!r} is no rectangle", "window", "Give whole (x0, y0, x1, y1)") from error
    if not (-(2**31) <= x0 < x1 < 2**31 and -(2**31) <= y0 < y1 < 2**31):
        raise UsageError(f"{window!r} holds no pixels", "window", "Give (x0, y0, x1, y1)")
    return (x0, y0, x1, y1)


class Format(enum.Enum):
    """What a pixel is, by the names of HdFormat: (numpy type, components)."""

    FLOAT32 = ("float32", 1)
    FLOAT32_VEC2 = ("float32", 2)
    FLOAT32_VEC3 = ("float32", 3)
    FLOAT32_VEC4 = ("float32", 4)
    INT32 = ("int32", 1)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The numpy type of a component."""
        return np.dtype(self.value[0])

    @property
    def components(self) -> int:
        """Components per pixel."""
        return self.value[1]

    def shape(self, width: int, height: int) -> tuple[int, ...]:
        """Of the array that holds an image: (height, width), and components where there are several."""
        return (height, width) if self.components == 1 else (height, width, self.components)


class RenderBuffer:
    """A bprim: pixels of one AOV, which fill rectangle by rectangle while a frame is rendered.

    Rectangles come when they are final; resolve() makes them visible. What is mapped does not change until it
    is unmapped, whatever is rendered meanwhile. Any thread may call any of its methods.
    """

    def __init__(self, path: str = "") -> None:
        self.path = path
        self._lock = threading.Lock()
        self._format = Format.FLOAT32
        self._pixels: Array = np.empty((0, 0), np.float32)
        self._waiting: list[tuple[Rectangle, Array]] = []
        self._finished: list[Rectangle] = []
        self._mapped = 0
        self._converged = False

    def allocate(
        self, width: int, height: int, format: Format = Format.FLOAT32_VEC4, clear_value: Any = 0
    ) -> None:
        """Makes it an image of this size, all of clear_value and not converged.

        Arrays that map() has returned before stay what they are. Throws UsageError while it is mapped, and
        MemoryLimitError.
        """
        try:
            pixels = np.empty(format.shape(width, height), format.dtype)
        except (MemoryError, ValueError) as error:  # ValueError: beyond what an address can say
            raise MemoryLimitError(f"{width} x {height} pixels do not fit into memory", self.path) from error
        pixels[...] = clear_value
        with self._lock:
            if self._mapped:
                raise UsageError("the buffer is mapped", self.path, "Call unmap() first")
            self._format, self._pixels = format, pixels
            self._waiting, self._finished = [], []
            self._converged = False

    @property
    def width(self) -> int:
        """Pixels."""
        return int(self._pixels.shape[1])

    @property
    def height(self) -> int:
        """Pixels."""
        return int(self._pixels.shape[0])

    @property
    def format(self) -> Format:
        return self._format

    @property
    def dtype(self) -> np.dtype[Any]:
        """The numpy type of a component."""
        return self._format.dtype

    @property
    def is_mapped(self) -> bool:
        return self._mapped > 0

    @property
    def is_converged(self) -> bool:
        """Whether all of the frame is in it, and final."""
        return self._converged

    @property
    def finished_rectangles(self) -> tuple[Rectangle, ...]:
        """Parts of the image that are final and visible; all else still is the clear value."""
        with self._lock:
            return tuple(self._finished)

    def map(self) -> Array:
        """The pixels as a read-only view, (height, width) or (height, width, components), top row first.

        Resolves before. Each call asks for one unmap().
        """
        with self._lock:
            self._resolve()
            self._mapped += 1
            view = self._pixels.view()
        view.flags.writeable = False
        return view

    def unmap(self) -> None:
        """Ends one map(). Throws UsageError where it is not mapped."""
        with self._lock:
            if not self._mapped:
                raise UsageError("the buffer is not mapped", self.path, "Call map() first")
            self._mapped -= 1

    @contextmanager
    def mapped(self) -> Iterator[Array]:
        """map() for the body of a `with` statement."""
        pixels = self.map()
        try:
            yield pixels
        finally:
            self.unmap()

    def resolve(self) -> None:
        """Makes visible what has become final since the last time. While it is mapped, nothing happens."""
        with self._lock:
            self._resolve()

    # What the renderer calls.

    def add(self, x0: int, y0: int, pixels: Array) -> None:
        """Takes over final pixels, (height, width[, components]), whose upper left one is (x0, y0)."""
        height, width = pixels.shape[:2]
        rectangle = (x0, y0, x0 + width, y0 + height)
        with self._lock:
            self._waiting.append((rectangle, pixels))

    def set_converged(self) -> None:
        """Says that the last rectangle has come."""
        with self._lock:
            self._resolve()
            self._converged = True

    def _resolve(self) -> None:
        if self._mapped:
            return
        for (x0, y0, x1, y1), pixels in self._waiting:
            part = self._pixels[y0:y1, x0:x1]
            part[...] = pixels.reshape(part.shape)
            self._finished.append((x0, y0, x1, y1))
        self._waiting = []


@dataclass(frozen=True)
class AovBinding:
    """An AOV, and the buffer that it is rendered into, as HdRenderPassAovBinding.

    clear_value: of pixels that are not rendered yet; None: the AOV's own. settings: of the AOV; `components`
    of a primvar.
    """

    aov_name: str
    render_buffer: RenderBuffer
    clear_value: Any = None
    settings: Mapping[str, Any] = field(default_factory=dict)
