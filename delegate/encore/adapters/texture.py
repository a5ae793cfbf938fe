"""Image files → linear Rec.709 pixels, read once per file and colour space."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio
import PyOpenColorIO as ocio
from pxr import Ar, Sdf

from encore.adapters.context import SyncContext

Pixels = npt.NDArray[np.float32]

# The same spaces in every ACES configuration, so a fixed one is used.
_CONFIG = "cg-config-v2.1.0_aces-v1.3_ocio-v2.3"
_SRGB, _LINEAR = "sRGB - Texture", "Linear Rec.709 (sRGB)"
# USD's name, and OpenImageIO's as it is found in files.
_WRAP_NAMES = {
    "black": "black",
    "clamp": "clamp",
    "periodic": "repeat",
    "repeat": "repeat",
    "mirror": "mirror",
}


class TextureError(Exception):
    """Why an image file cannot be read."""


class Textures:
    """The textures of a scene. scene: encore._core.Scene, to which pixels are added when first asked for."""

    def __init__(self, scene: Any, context: SyncContext) -> None:
        self._scene = scene
        self._context = context
        self._indices: dict[tuple[str, str], int] = {}

    def index(self, asset: Sdf.AssetPath | None, color_space: str, path: Sdf.Path) -> int:
        """The scene's texture for an asset; -1, and a report, where it cannot be read.

        color_space: sourceColorSpace of UsdUVTexture. path: the shader, for messages.
        """
        reports = self._context.reports
        if asset is None or not asset.path:
            reports.add("no texture file", "has no file, and gives its fallback", path)
            return -1
        if "<UDIM>" in asset.path:
            reports.add("UDIM texture", f"UDIM textures are not supported yet ({asset.path}): fallback", path)
            return -1
        resolved = asset.resolvedPath or str(Ar.GetResolver().Resolve(asset.path))
        if not resolved:
            reports.error("missing texture", f"{asset.path} does not exist, and gives its fallback", path)
            return -1
        key = resolved, color_space
        if key not in self._indices:
            self._indices[key] = self._load(resolved, color_space, path)
        elif self._indices[key] < 0:
            reports.error("unreadable texture", f"{asset.path} cannot be read", path)
        return self._indices[key]

    def wrap_modes(self, asset: Sdf.AssetPath | None) -> tuple[str, str]:
        """What the file's metadata says of wrapping, for useMetadata; black where it says nothing."""
        if asset is None or not asset.resolvedPath:
            return "black", "black"
        return _wrap_metadata(asset.resolvedPath)

    def _load(self, resolved: str, color_space: str, path: Sdf.Path) -> int:
        try:
            pixels = read_pixels(resolved, color_space)
        except TextureError as error:
            self._context.reports.error(
                "unreadable texture", f"{resolved} cannot be read ({error}), and gives its fallback", path
            )
            return -1
        if not np.isfinite(pixels).all():
            self._context.reports.error(
                "texture not finite", f"{resolved} holds infinite or NaN pixels, which count as 0", path
            )
            pixels = np.nan_to_num(pixels, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return int(self._scene.add_texture(resolved, pixels))


def read_pixels(resolved: str, color_space: str) -> Pixels:
    """(height, width, 4) float32, bottom row first, linear; alpha is not multiplied in. Raises TextureError.

    color_space: "raw", "sRGB" or "auto": sRGB for 8-bit images with at least three channels, as
    UsdPreviewSurface says.
    """
    with LocalFile(resolved) as name:
        config = oiio.ImageSpec()
        config.attribute("oiio:UnassociatedAlpha", 1)
        source = oiio.ImageInput.open(name, config)
        if source is None:
            raise TextureError(oiio.geterror() or "unknown format")
        spec = source.spec()
        if spec.width < 1 or spec.height < 1 or spec.nchannels < 1:
            raise TextureError(f"it has {spec.width} × {spec.height} pixels of {spec.nchannels} channels")
        read = source.read_image(0, 0, 0, min(spec.nchannels, 4), oiio.FLOAT)
        source.close()
        if read is None:
            raise TextureError(source.geterror() or "it is truncated")
    pixels = _four_channels(np.asarray(read, dtype=np.float32).reshape(spec.height, spec.width, -1))
    is_srgb = color_space == "sRGB" or (
        color_space == "auto" and spec.nchannels >= 3 and spec.format.basetype == oiio.UINT8
    )
    if is_srgb:
        _srgb_processor().applyRGBA(pixels)
    return pixels


def _four_channels(pixels: Pixels) -> Pixels:
    """RGBA with the bottom row first. Grey goes into all of RGB; a second channel of two is alpha."""
    height, width, channels = pixels.shape
    result = np.ones((height, width, 4), np.float32)
    flipped = pixels[::-1]
    if channels <= 2:
        result[..., :3] = flipped[..., :1]
        if channels == 2:
            result[..., 3] = flipped[..., 1]
    else:
        result[..., :channels] = flipped
    return result


@functools.cache
def _srgb_processor() -> ocio.CPUProcessor:
    config = ocio.Config.CreateFromBuiltinConfig(_CONFIG)
    # The default's approximate powers make white brighter than 1.
    return config.getProcessor(_SRGB, _LINEAR).getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)


def _wrap_metadata(resolved: str) -> tuple[str, str]:
    with LocalFile(resolved) as name:
        source = oiio.ImageInput.open(name)
        if source is None:
            return "black", "black"
        spec = source.spec()
        source.close()
    modes = spec.get_string_attribute("wrapmodes").split(",")
    s, t = (modes * 2)[:2]
    s, t = (spec.get_string_attribute(key) or mode for key, mode in (("wrapS", s), ("wrapT", t)))
    return _WRAP_NAMES.get(s.strip(), "black"), _WRAP_NAMES.get(t.strip(), "black")


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
