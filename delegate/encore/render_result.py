"""What a frame was rendered to: arrays by AOV, statistics, reports; and files of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd

from encore.channels import EMPTY_DEPTH, Part, names, require_finite
from encore.color import ColorOptions, display_transform
from encore.errors import UsageError
from encore.exr_file import open_exr
from encore.image_file import ImageFile, ImageInfo
from encore.lpe import LAYERS
from encore.output import atomic_file, check_format, check_writable
from encore.png_file import PngFile
from encore.render_buffer import Array
from encore.report import Report


class RenderResult(Mapping[str, Array]):
    """Arrays by AOV: (height, width) or (height, width, components), read-only, top row first.

    They stay what they are, whatever is rendered later. statistics: as `--stats` writes of a frame
    (docs/usage.md). reports: what was rendered differently from what the stage says.
    """

    def __init__(
        self,
        arrays: Mapping[str, Array],
        time: Usd.TimeCode,
        statistics: Mapping[str, Any],
        reports: tuple[Report, ...],
        info: ImageInfo,
    ) -> None:
        self._arrays = dict(arrays)
        self.time = time
        self.statistics = statistics
        self.reports = reports
        self._info = info

    def __getitem__(self, aov: str) -> Array:
        return self._arrays[aov]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        return f"<RenderResult {self.width} x {self.height}: {', '.join(self)}>"

    @property
    def width(self) -> int:
        """Pixels of the arrays."""
        return self._info.width

    @property
    def height(self) -> int:
        """Pixels of the arrays."""
        return self._info.height

    @property
    def window(self) -> tuple[int, int, int, int]:
        """The pixels (x0, y0, x1, y1) of the whole image that the arrays hold, y down."""
        x, y = self._info.x, self._info.y
        return (x, y, x + self.width, y + self.height)

    @property
    def camera(self) -> str:
        """Path of the camera; empty: the automatic one."""
        return str(self.statistics["camera"])

    def save(self, path: str | os.PathLike[str], color: ColorOptions | None = None) -> None:
        """Writes an image file, whole or not at all. Throws OutputError, and UsageError for an unknown kind.

        .exr: every AOV of the result, scene-linear, 32 bit. .png: "color" alone, 8 bit, as `color` says: sRGB
        without it.
        """
        file_path = os.fspath(path)
        check_format(file_path)
        check_writable(file_path)
        is_png = Path(file_path).suffix.lower() == ".png"
        if is_png and "color" not in self:
            raise UsageError("PNG holds color, which was not rendered", file_path, 'Render the AOV "color"')
        found = [part for aov in (("color",) if is_png else self) for part in self._parts(aov)]
        require_finite(found, 0, 0)
        with atomic_file(file_path) as temporary:
            file: ImageFile
            if is_png:
                file = PngFile(file_path, temporary, self._info, display_transform(color or ColorOptions()))
            else:
                file = open_exr(file_path, temporary, self._info, names(found))
            file.add(0, 0, found)
            file.close()

    def _parts(self, aov: str) -> list[Part]:
        """The channels of an AOV, by the names of docs/aovs.md."""
        pixels = self._arrays[aov].astype(np.float32).reshape(self.height, self.width, -1)
        count = pixels.shape[2]
        if aov == "color":
            return [Part(("R", "G", "B"), pixels[..., :3]), Part(("A",), pixels[..., 3:])]
        if aov == "alpha":
            return [] if "color" in self else [Part(("A",), pixels)]
        if aov in ("depth", "cameraDepth"):
            if aov == "cameraDepth" and "depth" in self:
                return []
            return [Part(("Z",), np.where(np.isposinf(pixels), EMPTY_DEPTH, pixels))]
        if aov in ("normal", "N") and aov != "normal" and "normal" in self:
            return []
        name = "N" if aov == "normal" else aov
        if count == 1:
            return [Part((name,), pixels)]
        letters = "RGBA" if aov in LAYERS else "XYZW"
        return [Part(tuple(f"{name}.{letter}" for letter in letters[:count]), pixels)]
