"""The textures of a scene: found and checked at once, read when core asks for their pixels."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Usd, UsdShade

from encore.adapters import image
from encore.adapters.context import SyncContext
from encore.adapters.image import HalfPixels, ImageHeader, TextureError
from encore.errors import AssetError

_FIRST_TILE, _LAST_TILE = 1001, 2000


class Textures:
    """Adds files to a scene (encore._core.Scene), once per file and colour space."""

    def __init__(self, scene: Any, context: SyncContext) -> None:
        self._scene = scene
        self._context = context
        self._indices: dict[tuple[str, str], int] = {}
        self._headers: dict[int, ImageHeader] = {}

    def index(self, asset: Sdf.AssetPath | None, color_space: str, path: Sdf.Path) -> int:
        """The scene's texture for an asset; -1, and a report, where it cannot be read.

        color_space: as image.read_pixels(). path: the prim that names it, for messages.
        """
        reports = self._context.reports
        if asset is not None and not isinstance(asset, Sdf.AssetPath):
            reports.error("bad texture file", f"its file is {asset!r}, no asset: it gives its fallback", path)
            return -1
        if asset is None or not asset.path:
            reports.add("no texture file", "has no file, and gives its fallback", path)
            return -1
        # A relative path that USD did not find beside its layer is not looked for anywhere else.
        resolved = asset.resolvedPath
        if not resolved and Path(asset.path).is_absolute():
            resolved = str(Ar.GetResolver().Resolve(asset.path))
        if not resolved:
            reports.error("missing texture", f"{asset.path} does not exist, and gives its fallback", path)
            return -1
        return self._resolved_index(resolved, color_space, path)

    def light_texture(self, asset: Sdf.AssetPath | None, color_space: str, path: Sdf.Path) -> int:
        """index() of a light's inputs:texture:file; -1 where it names none.

        color_space: the attribute's colorSpace, or "auto". path: the light, for messages.
        """
        if asset is None or not asset.path:
            return -1
        metadata = "" if color_space == "auto" else color_space
        return self.index(asset, self.color_space("auto", metadata, path), path)

    def udim(self, file: Usd.Attribute, color_space: str, path: Sdf.Path) -> list[int] | None:
        """Textures by UDIM tile, from 1001 on, -1 for tiles that do not exist; None where it is no pattern.

        file: the attribute that names the asset.
        """
        asset = file.Get(self._context.time) if file else None
        if not isinstance(asset, Sdf.AssetPath) or not UsdShade.UdimUtils.IsUdimIdentifier(asset.path):
            return None
        specs = file.GetPropertyStack(self._context.time)
        # Of the spec that has the value: a stronger one may only say its colour space.
        layer = next(
            (s.layer for s in specs if s.HasDefaultValue() or s.layer.ListTimeSamplesForPath(s.path)),
            self._context.stage.GetRootLayer(),
        )
        tiles: dict[int, int] = {}
        for resolved, name in UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer):
            if _FIRST_TILE <= int(name) <= _LAST_TILE:
                tiles[int(name) - _FIRST_TILE] = self._resolved_index(resolved, color_space, path)
        if not tiles:
            self._context.reports.error(
                "missing texture", f"no tile of {asset.path} exists, and it gives its fallback", path
            )
        return [tiles.get(i, -1) for i in range(max(tiles, default=-1) + 1)]

    def color_space(self, source: str, metadata: str, path: Sdf.Path) -> str:
        """The colour space of a file: what sourceColorSpace says, and with "auto" the file's colorSpace."""
        if source not in ("raw", "sRGB", "auto", ""):
            self._context.reports.add(
                "sourceColorSpace", f"sourceColorSpace {source} is unknown: auto is used", path
            )
            source = "auto"
        if source not in ("auto", ""):
            return source
        if metadata and not image.is_color_space(metadata):
            self._context.reports.add(
                "color space",
                f"colour space {metadata} is unknown: what the file's format says is used",
                path,
            )
            metadata = ""
        return metadata or "auto"

    def header(self, index: int) -> ImageHeader | None:
        """Of one of the scene's textures; None for -1."""
        return self._headers.get(index)

    def _resolved_index(self, resolved: str, color_space: str, path: Sdf.Path) -> int:
        key = resolved, color_space
        if key not in self._indices:
            self._indices[key] = self._add(resolved, color_space, path)
        elif self._indices[key] < 0:
            self._context.reports.error("unreadable texture", f"{resolved} cannot be read", path)
        return self._indices[key]

    def _add(self, resolved: str, color_space: str, path: Sdf.Path) -> int:
        try:
            header = image.read_header(resolved)
        except TextureError as error:
            self._context.reports.error(
                "unreadable texture", f"{resolved} cannot be read ({error}), and gives its fallback", path
            )
            return -1
        read = self._reader(resolved, color_space, path)
        index = int(self._scene.add_texture_source(resolved, header.width, header.height, read))
        self._headers[index] = header
        return index

    def _reader(self, resolved: str, color_space: str, path: Sdf.Path) -> Callable[[], HalfPixels]:
        """What gives the pixels later. It raises AssetError: then it is too late for the fallback."""
        return functools.partial(_read, resolved, color_space, path, self._context)


def _read(resolved: str, color_space: str, path: Sdf.Path, context: SyncContext) -> HalfPixels:
    try:
        pixels, repairs = image.read_half_pixels(resolved, color_space)
    except TextureError as error:
        raise AssetError(
            f"the texture {resolved} cannot be read ({error})",
            str(path),
            "Repair the file, or take it off the shader to render its fallback",
        ) from error
    if repairs.not_a_number:
        context.reports.error(
            "texture not finite", f"{repairs.not_a_number} pixels of {resolved} are NaN, and count as 0", path
        )
    if repairs.too_large:
        context.reports.add(
            "texture too bright",
            f"{repairs.too_large} pixels of {resolved} are beyond {image.HALF_MAX:g}, and are held there",
            path,
        )
    return pixels
