"""The materials of a stage: read when first asked for, kept from frame to frame, and read after changes."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

from pxr import Sdf, Usd, UsdShade

from encore.adapters.context import SyncContext
from encore.adapters.instance_primvars import COLOR, OPACITY
from encore.adapters.material import (
    GREY,
    MaterialData,
    default_material,
    display_material,
    read_material,
)
from encore.adapters.primvars import Primvar, might_vary
from encore.adapters.texture import Textures
from encore.report import Log


@dataclass(frozen=True, eq=False)
class BoundMaterial:
    """A material, and the textures (of Textures) that it asked for, in this order. Two are never equal."""

    data: MaterialData
    textures: tuple[int, ...] = ()


@dataclass
class _Entry:
    """bound: None where it has no surface that is supported. prims: that it was read from; None: not known
    yet.

    volatile: it may change without a change of the stage. varies: with time; None: not known yet.
    """

    bound: BoundMaterial | None
    textures: tuple[int, ...]
    log: Log
    volatile: bool
    prims: frozenset[Sdf.Path] | None = None
    varies: bool | None = None


@dataclass
class Materials:
    """By prim; and those that stand in for what has none. read: how many were read in this frame."""

    textures: Textures
    read: int = 0
    default: BoundMaterial = field(default_factory=lambda: BoundMaterial(default_material()))
    _entries: dict[Sdf.Path, _Entry] = field(default_factory=dict)
    _fallbacks: dict[Any, BoundMaterial] = field(default_factory=dict)
    _reported: set[Sdf.Path] = field(default_factory=set)

    def begin(self, stale: frozenset[int]) -> None:
        """Starts a frame. stale: textures that are out of date."""
        self.read = 0
        self._reported.clear()
        self._drop(e for e in self._entries.values() if e.volatile or not stale.isdisjoint(e.textures))

    def material(self, material: UsdShade.Material, context: SyncContext) -> BoundMaterial | None:
        """That of a prim; None where it has no surface that is supported. Reports go to each frame once."""
        path = material.GetPath()
        entry = self._entries.get(path)
        if entry is None:
            self._reported.add(path)
            entry = self._entries[path] = self._read(material, context)
        elif path not in self._reported:
            self._reported.add(path)
            context.reports.replay(entry.log)
        return entry.bound

    def _read(self, material: UsdShade.Material, context: SyncContext) -> _Entry:
        self.read += 1
        mark, self.textures.volatile = context.reports.mark, False
        self.textures.touched.clear()
        data = read_material(material, self.textures, context)
        textures = tuple(dict.fromkeys(self.textures.touched))
        log = context.reports.since(mark)
        files = any("GLSL" in kind for kind, *_ in log) if data is None else data.reads_files
        bound = None if data is None else BoundMaterial(data, textures)
        return _Entry(bound, textures, log, self.textures.volatile or files)

    def fallback(
        self, color: Primvar | None, opacity: Primvar | None = None, given: Collection[str] = ()
    ) -> BoundMaterial:
        """For what has no material: its displayColor, or grey, and its displayOpacity.

        given: names of what instances may say instead.
        """
        varying = COLOR in given or (color is not None and not color.is_constant)
        shown = None if varying else GREY if color is None else _constant(color)
        fades = OPACITY in given or (opacity is not None and not opacity.is_constant)
        presence = None if fades else 1.0 if opacity is None else min(max(_constant(opacity)[0], 0.0), 1.0)
        if shown is GREY and presence == 1.0:
            return self.default
        known = self._fallbacks.get((shown, presence))
        if known is None:
            known = self._fallbacks[shown, presence] = BoundMaterial(display_material(shown, presence))
        return known

    # Changes

    def forget(self, changed: Collection[Sdf.Path], resynced: Collection[Sdf.Path], stage: Usd.Stage) -> None:
        """Drops what was read from prims with changed properties, or from any at or below resynced ones."""
        if not changed and not resynced:
            return
        dropped = []
        for path, entry in self._entries.items():
            if entry.prims is None:
                entry.prims = sources(path, stage)
            if not entry.prims.isdisjoint(changed) or any(
                p.HasPrefix(r) or r.HasPrefix(path) for r in resynced for p in entry.prims
            ):
                dropped.append(entry)
        self._drop(dropped)

    def forget_varying(self, stage: Usd.Stage) -> None:
        """Drops what may be another at another time."""
        for path, entry in self._entries.items():
            if entry.varies is None:
                if entry.prims is None:
                    entry.prims = sources(path, stage)
                entry.varies = any(might_vary(stage.GetPrimAtPath(p)) for p in entry.prims)
        self._drop(e for e in self._entries.values() if e.varies)

    def clear(self) -> None:
        self._entries.clear()

    def _drop(self, entries: Iterable[_Entry]) -> None:
        gone = {id(e) for e in entries}
        if gone:
            self._entries = {p: e for p, e in self._entries.items() if id(e) not in gone}


def sources(material: Sdf.Path, stage: Usd.Stage) -> frozenset[Sdf.Path]:
    """The prims that a material is read from: it, all below it, and what any of those is connected to.

    Prims that connections name but that do not exist are among them.
    """
    found: set[Sdf.Path] = set()
    waiting = [material]
    while waiting:
        path = waiting.pop()
        prim = stage.GetPrimAtPath(path)
        if path in found:
            continue
        found.add(path)
        if prim and prim.IsInstanceProxy():
            found.add(prim.GetPrimInPrototype().GetPath())
        if not prim or prim.IsPseudoRoot():
            continue
        waiting += [child.GetPath() for child in prim.GetFilteredChildren(_ALL)]
        for attribute in prim.GetAuthoredAttributes():
            if attribute.HasAuthoredConnections():
                waiting += [connection.GetPrimPath() for connection in attribute.GetConnections()]
    return frozenset(found)


_ALL = Usd.TraverseInstanceProxies(Usd.PrimIsActive)


def _constant(primvar: Primvar) -> tuple[float, ...]:
    """The value of a constant primvar."""
    index = primvar.indices[0] if primvar.indices is not None else 0
    return tuple(primvar.values[index].tolist())
