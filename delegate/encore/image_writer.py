"""Writes an image in the background, rectangle by rectangle, while it is rendered."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from encore.channels import Part, names, parts, pixel_types, require_finite
from encore.color import DisplayTransform
from encore.errors import InternalError
from encore.exr_file import open_exr
from encore.image_file import ImageFile, ImageInfo
from encore.output import atomic_file
from encore.png_file import PngFile

# Pixels that may wait to be written.
_QUEUE_BYTES = 64 * 2**20


class ImageWriter:
    """A file whose pixels come while the body of a `with` statement runs.

    Leaving the body waits until the file is on disk under its name; leaving it by an exception leaves none.
    transform: for PNG; EXR is scene-linear. select: what of a rectangle's images the file holds.
    """

    def __init__(
        self,
        path: str,
        info: ImageInfo,
        transform: DisplayTransform,
        select: Callable[[Mapping[str, Any]], list[Part]] = parts,
    ) -> None:
        self._path, self._info, self._transform, self._select = path, info, transform, select
        self._queue = _Queue(_QUEUE_BYTES)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="image writer", daemon=True)
        self.busy_s = 0.0  # time that writing took, most of it besides rendering

    def add(self, x0: int, y0: int, images: Mapping[str, Any]) -> None:
        """The tile callback of encore._core.render(): takes over the arrays.

        Waits while many others are still to be written. Throws what has stopped the writing.
        """
        if not self._queue.put((x0, y0, images), _bytes(images)):
            self._thread.join()
            raise self._error or InternalError("the image is complete already", self._path)

    @property
    def failed(self) -> bool:
        """True once writing has stopped; leaving the body then raises the reason."""
        return self._error is not None

    def __enter__(self) -> ImageWriter:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._queue.end()
        else:
            self._queue.close()
        self._thread.join()
        # What stopped the writing, rather than that the render was stopped for it.
        if self._error is not None and self._error is not error:
            raise self._error

    def _run(self) -> None:
        try:
            with atomic_file(self._path) as temporary:
                self._write(temporary)
                started = time.perf_counter()
            self.busy_s += time.perf_counter() - started
        except _Abandoned:
            pass
        except BaseException as error:
            self._error = error
        finally:
            self._queue.close()

    def _write(self, temporary: str) -> None:
        file: ImageFile | None = None
        while (rectangle := self._queue.get()) is not None:
            started = time.perf_counter()
            x0, y0, images = rectangle
            found = self._select(images)
            require_finite(found, x0, y0)
            file = file or self._open(temporary, found)
            file.add(x0, y0, found)
            self.busy_s += time.perf_counter() - started
        if file is None:
            raise InternalError("the frame came without pixels", self._path)
        started = time.perf_counter()
        file.close()
        self.busy_s += time.perf_counter() - started

    def _open(self, temporary: str, found: list[Part]) -> ImageFile:
        if Path(self._path).suffix.lower() == ".png":
            return PngFile(self._path, temporary, self._info, self._transform)
        return open_exr(self._path, temporary, self._info, names(found), pixel_types(found))


class _Abandoned(Exception):  # noqa: N818
    """Nobody wants the file any more."""


class _Queue:
    """From one thread to another, in order. Holds at most `limit` bytes, or one item that is larger."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._items: deque[tuple[Any, int]] = deque()
        self._held = 0
        self._ended = self._closed = False
        self._changed = threading.Condition()

    def put(self, item: Any, size: int) -> bool:
        """Waits for room. False, without taking the item, once the queue is closed or ended."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._closed or not self._items or self._held + size <= self._limit
            )
            if self._closed or self._ended:
                return False
            self._items.append((item, size))
            self._held += size
            self._changed.notify_all()
            return True

    def get(self) -> Any:
        """Waits for the next item; None after the last. Throws _Abandoned once the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._ended or bool(self._items))
            if self._closed:
                raise _Abandoned
            if not self._items:
                return None
            item, size = self._items.popleft()
            self._held -= size
            self._changed.notify_all()
            return item

    def end(self) -> None:
        """No more items come."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def close(self) -> None:
        """Lets go of both sides."""
        with self._changed:
            self._closed = True
            self._items.clear()
            self._held = 0
            self._changed.notify_all()


def _bytes(images: Mapping[str, Any]) -> int:
    """Of all arrays, those in dictionaries of dictionaries included."""
    return sum(_bytes(v) if isinstance(v, Mapping) else v.nbytes for v in images.values())
