"""The textures of a scene: found and checked at once, read when core asks for their pixels."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Usd, UsdShade

from encore import _core
from encore.adapters import image
from encore.adapters.context import SyncContext
from encore.adapters.image import HalfPixels, ImageHeader, TextureError
from encore.errors import AssetError
from encore.report import Log, Reports, Severity

_FIRST_TILE, _LAST_TILE = 1001, 2000


@dataclass
class _Texture:
    """error: why it cannot be read, where that is so. Handles of core hold it, and must not be held by it."""

    resolved: str
    stamp: object
    read: Callable[[], HalfPixels] | None = None
    header: ImageHeader | None = None
    error: str = ""
    reports: Reports | None = None  # of the frame that has it
    log: Log = ()  # what its pixels came to, once they have been read


class Textures:
    """Finds files once per file and colour space, and keeps what is known of them while they stay as they
    are.

    Indices are its own: add_to() gives scenes the handles. touched: indices that were asked for, to be
    emptied by who wants to know. volatile: whether what was asked for may change without a change of the
    stage or of a file that is known, as files that are missing and patterns of files do; to be set to False
    by the same.
    """

    def __init__(self) -> None:
        self._context: Any = None
        self._entries: list[_Texture] = []
        self._handles: list[Any] = []  # encore._core.Texture; None where it cannot be read
        self._indices: dict[tuple[str, str], int] = {}
        self.touched: list[int] = []
        self.volatile = False

    def begin(self, context: SyncContext) -> frozenset[int]:
        """Starts a frame; indices of files that have changed since they were read: they get new ones."""
        self._context = context
        self.touched.clear()
        found = ((i, self._entries[i]) for i in self._indices.values())
        stale = {i for i, entry in found if _stamp(entry.resolved) != entry.stamp}
        self._indices = {key: i for key, i in self._indices.items() if i not in stale}
        return frozenset(stale)

    def handle(self, index: int) -> Any:
        """The encore._core.Texture of an index; this frame's reports say what is wrong with its pixels."""
        entry = self._entries[index]
        entry.reports = self._context.reports
        return self._handles[index]

    def pixels(self, index: int) -> HalfPixels:
        """Of an index, as core gets them. Raises AssetError."""
        entry = self._entries[index]
        entry.reports = self._context.reports
        assert entry.read is not None, "there is an index for what can be read only"
        return entry.read()

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
            self.volatile = True
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
        self.volatile = True
        specs = file.GetPropertyStack(self._context.time)
        # Of the spec that has the value: a stronger one may only say its colour space.
        layer = next(
            (s.layer for s in specs if s.HasDefaultValue() or s.layer.ListTimeSamplesForPath(s.path)),
            self._context.stage.GetRootLayer(),
        )
        tiles: dict[int, int] = {}
        with Ar.ResolverContextBinder(self._context.stage.GetPathResolverContext()):
            found = UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer)
        for resolved, name in found:
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
        """Of a texture; None for -1."""
        return self._entries[index].header if index >= 0 else None

    def _resolved_index(self, resolved: str, color_space: str, path: Sdf.Path) -> int:
        key = resolved, color_space
        index = self._indices.get(key)
        if index is None:
            index = self._indices[key] = len(self._entries)
            entry, handle = _open(resolved, color_space, path)
            self._entries.append(entry)
            self._handles.append(handle)
        entry = self._entries[index]
        if self._handles[index] is None:
            self.volatile = True
            what = f"{resolved} cannot be read ({entry.error}), and gives its fallback"
            self._context.reports.error("unreadable texture", what, path)
            return -1
        self.touched.append(index)
        return index


def _stamp(resolved: str) -> object:
    """Differs when the file has changed."""
    stamp = Ar.GetResolver().GetModificationTimestamp("", Ar.ResolvedPath(resolved))
    return stamp.GetTime() if stamp.IsValid() else None


def _open(resolved: str, color_space: str, path: Sdf.Path) -> tuple[_Texture, Any]:
    """What is known of a file, and its handle, if it can be read. path: of the prim, for messages."""
    entry = _Texture(resolved, _stamp(resolved))
    try:
        entry.header = header = image.read_header(resolved)
    except TextureError as error:
        entry.error = str(error)
        return entry, None
    entry.read = functools.partial(_read, entry, color_space, path)
    again = functools.partial(_report_again, entry)
    return entry, _core.Texture(resolved, header.width, header.height, entry.read, again)


def _read(entry: _Texture, color_space: str, path: Sdf.Path) -> HalfPixels:
    """The pixels, when core asks for them. Raises AssetError: it is too late for the fallback."""
    resolved, reports = entry.resolved, Reports() if entry.reports is None else entry.reports
    try:
        pixels, repairs = image.read_half_pixels(resolved, color_space)
    except TextureError as error:
        raise AssetError(
            f"the texture {resolved} cannot be read ({error})",
            str(path),
            "Repair the file, or take it off the shader to render its fallback",
        ) from error
    found: list[tuple[str, str, Sdf.Path | str, Severity]] = []
    if repairs.not_a_number:
        message = f"{repairs.not_a_number} pixels of {resolved} are NaN, and count as 0"
        found.append(("texture not finite", message, path, Severity.ERROR))
    if repairs.too_large:
        beyond = f"{repairs.too_large} pixels of {resolved} are beyond {image.HALF_MAX:g}"
        found.append(("texture too bright", f"{beyond}, and are held there", path, Severity.WARNING))
    entry.log = tuple(found)
    reports.replay(entry.log)
    return pixels


def _report_again(entry: _Texture) -> None:
    """What is wrong with pixels that core still has from an earlier frame."""
    if entry.reports is not None:
        entry.reports.replay(entry.log)
