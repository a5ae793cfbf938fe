"""PNG files of the composite, written while the image is rendered."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from encore.channels import Part, Pixels
from encore.color import DisplayTransform
from encore.image_file import Bands, ImageInfo, OiioOutput

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class PngFile:
    """8 bits and unassociated alpha, as PNG asks for, through the display transform."""

    def __init__(self, path: str, temporary: str, info: ImageInfo, transform: DisplayTransform) -> None:
        spec = oiio.ImageSpec(info.width, info.height, 4, "uint8")
        spec.alpha_channel = 3
        spec.attribute("oiio:UnassociatedAlpha", 1)
        spec.attribute("PixelAspectRatio", float(info.pixel_aspect_ratio))
        spec.attribute("Software", f"Encore {info.header.get('encore:version', '')}".strip())
        spec.attribute("encore:display", transform.description)
        for name, value in info.header.items():
            spec.attribute(name, value)
        self._transform = transform
        self._bands = Bands(info, 4, np.uint8)
        self._output = OiioOutput("png", path, temporary, spec)

    def add(self, x0: int, y0: int, found: Sequence[Part]) -> None:
        pixels = {part.names: part.pixels for part in found}
        alpha: Pixels = np.clip(pixels["A",], 0, 1)
        # Light without coverage (a visible lamp, for one) has nothing to be divided by, and stays as it is.
        divisor = alpha.copy()
        divisor[divisor == 0] = 1
        display = [self._transform.apply(pixels["R", "G", "B"] / divisor), alpha]
        rows = self._bands.add(x0, y0, [(np.clip(p, 0, 1) * 255 + 0.5).astype(np.uint8) for p in display])
        if rows is not None:
            self._output.write_rows(y0, rows)

    def close(self) -> None:
        self._bands.require_end()
        self._output.close()
        # OpenImageIO's writer does not notice a disk that fills up.
        if not _is_whole(self._output.temporary):
            raise self._output.fail("the file is incomplete")


def _is_whole(path: str) -> bool:
    """Whether every chunk is there with its checksum, up to the last (PNG specification, clause 5)."""
    with Path(path).open("rb") as file:
        whole = file.read(8) == _SIGNATURE
        kind = b""
        while whole and kind != b"IEND":
            length, kind = struct.unpack(">I4s", file.read(8).ljust(8, b"\0"))
            checksum = zlib.crc32(file.read(length), zlib.crc32(kind))
            whole = file.read(4) == checksum.to_bytes(4, "big")
        return whole and not file.read(1)
