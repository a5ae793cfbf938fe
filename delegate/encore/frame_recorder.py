"""One render of a frame: translate the stage at a time, render it to files, and hand back statistics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from pxr import Usd

from encore.channels import Part, parts
from encore.color import DisplayTransform
from encore.errors import Cancelled
from encore.image_file import ImageInfo, limit_threads
from encore.image_header import header
from encore.image_writer import ImageWriter
from encore.render_delegate import RenderDelegate
from encore.render_index import RenderIndex, SyncOptions
from encore.render_pass import ProgressCallback, sync
from encore.render_products import OutputFile, Render


@dataclass(frozen=True)
class RenderedFrame:
    """What is to be said of a render. statistics: encore._core.render()'s. reports: the translation's.

    size: of the whole image. write_s: time that writing took, most of it while the frame was rendered.
    written: the files that are on disk. failure: why others are not; None: there are no others.
    """

    statistics: Mapping[str, Any]
    reports: Any
    camera: str
    sync_s: float
    write_s: float
    size: tuple[int, int]
    written: tuple[str, ...]
    failure: BaseException | None = None


class FrameRecorder:
    """Renders frames of a stage to files, on the device of a delegate.

    source: the stage's name as the user gave it, for the header. transform: for PNG.
    """

    def __init__(
        self, stage: Usd.Stage, delegate: RenderDelegate, source: str, transform: DisplayTransform
    ) -> None:
        self.stage = stage
        self.source = source
        self.transform = transform
        self.render_pass = delegate.create_render_pass()
        self._index: RenderIndex | None = None
        self._translated: tuple[Usd.TimeCode, Mapping[str, Any], Any] | None = None

    def render(
        self,
        time_code: Usd.TimeCode,
        label: str,
        render: Render,
        progress: ProgressCallback | None = None,
    ) -> RenderedFrame:
        """Renders the stage at a time to the files of the render, which are written meanwhile.

        label: the frame's name in headers. A file that cannot be written leaves the others alone. Throws
        EncoreError.
        """
        limit_threads(render.settings["threads"])
        started = time.perf_counter()
        translation = self._translate(time_code, render)
        sync_s = time.perf_counter() - started
        size = translation.width, translation.height
        settings = {**render.settings, "width": size[0], "height": size[1]}
        x0, y0, x1, y1 = render.window or (0, 0, *size)
        common = {
            **header(settings, translation, self.render_pass.device, self.source, label),
            **render.source,
            **({"encore:dataWindow": f"{x0} {y0} {x1} {y1}"} if render.window else {}),
        }
        files = _Files(
            [
                self._writer(
                    file,
                    ImageInfo(
                        x1 - x0,
                        y1 - y0,
                        settings["reuse_tile_pixels"],
                        common | file.header(),
                        translation.pixel_aspect_ratio,
                        x0,
                        y0,
                        size,
                        file.space.chromaticities,
                    ),
                )
                for file in render.files
            ],
        )
        # Only what is asked for reaches core.
        more: dict[str, Any] = {"window": render.window} if render.window else {}
        if render.aovs:
            more["aovs"] = [aov.arguments() for aov in render.aovs]

        def advance(done: float, stage: str) -> bool:
            return not files.failed and (progress is None or progress(done, stage))

        with files:
            statistics = self.render_pass.execute(translation, settings | more, files.add, advance)
            if not advance(1.0, "write"):
                raise Cancelled
        return RenderedFrame(
            statistics,
            translation.reports,
            translation.camera_path,
            sync_s,
            sum(writer.busy_s for writer in files.writers),
            size,
            tuple(f.path for f, failed in zip(render.files, files.failures, strict=True) if failed is None),
            files.failure,
        )

    def _translate(self, time_code: Usd.TimeCode, render: Render) -> Any:
        """The stage at a time; the one before, where only the film is another."""
        if self._translated is not None and self._translated[:2] == (time_code, render.sync):
            return self._translated[2].on_film(render.film)
        options = SyncOptions(**render.sync_options())
        if self._index is None:
            self._index = RenderIndex(self.stage, options)
        self._index.options = options
        self._translated = None
        translation = sync(self._index, time_code, self.source)
        self._translated = (time_code, render.sync, translation)
        return translation

    def _writer(self, file: OutputFile, info: ImageInfo) -> ImageWriter:
        # PNG is display-referred, whatever the working space.
        linear = Path(file.path).suffix.lower() != ".png"
        color_map = file.space.map if linear and file.space.apply is not None else _unchanged
        selection = file.selection

        def select(images: Mapping[str, Any]) -> list[Part]:
            if selection is not None:
                return selection.parts(images, color_map)
            return parts(images, color_map)

        return ImageWriter(file.path, info, self.transform, select)


class _Files:
    """Several ImageWriters as one. What stops one does not stop the others; add() fails when all have."""

    def __init__(self, writers: list[ImageWriter]) -> None:
        self.writers = writers
        self.failures: list[BaseException | None] = [None] * len(writers)

    def add(self, x0: int, y0: int, images: Mapping[str, Any]) -> None:
        """The tile callback of encore._core.render()."""
        self._each(lambda writer: writer.add(x0, y0, images))
        if self.failed and self.failure is not None:
            raise self.failure

    @property
    def failed(self) -> bool:
        """Whether none of the files can be written any more."""
        return all(w.failed or f is not None for w, f in zip(self.writers, self.failures, strict=True))

    @property
    def failure(self) -> BaseException | None:
        """The first."""
        return next((failure for failure in self.failures if failure is not None), None)

    def __enter__(self) -> _Files:
        for writer in self.writers:
            writer.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for i, writer in enumerate(self.writers):
            failure = error or self.failures[i]
            try:
                writer.__exit__(type(failure) if failure else None, failure, trace)
            except BaseException as own:
                self.failures[i] = self.failures[i] or own
        # What has stopped all writing, rather than that the render was stopped for it.
        if self.writers and all(failure is not None for failure in self.failures):
            assert self.failure is not None
            raise self.failure

    def _each(self, action: Callable[[ImageWriter], None]) -> None:
        """For every writer that still writes."""
        for i, writer in enumerate(self.writers):
            if self.failures[i] is None:
                try:
                    action(writer)
                except BaseException as error:
                    self.failures[i] = error


def _unchanged(pixels: Any) -> Any:
    return pixels
