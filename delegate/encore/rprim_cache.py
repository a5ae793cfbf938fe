"""What is known of rprims from frame to frame: what was read of each, for what, and what it came to."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pxr import Sdf, UsdGeom

from encore.adapters.authored import Authored
from encore.adapters.context import Matrix
from encore.adapters.instance_primvars import COLOR, OPACITY
from encore.adapters.material import MaterialData
from encore.adapters.mesh import MeshData
from encore.adapters.primvars import IntArray, Wanted, might_vary
from encore.groups import Rprim
from encore.materials import BoundMaterial
from encore.readers import Geometry
from encore.report import Log
from encore.scene_builder import PreparedMesh

NO_NAMES: frozenset[str] = frozenset()


@dataclass(slots=True, eq=False)
class SyncedRprim:
    """A mesh in its own space, with its materials. to_prim: from that space to the prim's; None: the same.

    share_key: equal for rprims with the same geometry, which differ in material, shading rate and place only;
    None: shared with none. face_materials: per face which one of of_faces, -1: material. reads: names of the
    primvars that its materials read of instances.
    """

    mesh: PreparedMesh
    to_prim: Matrix | None
    material: BoundMaterial
    face_materials: IntArray | None = None
    of_faces: tuple[BoundMaterial, ...] = ()
    share_key: Any = None
    reads: frozenset[str] = NO_NAMES

    @property
    def data(self) -> MeshData:
        return self.mesh.data

    def matrix(self, rprim: Rprim) -> Matrix:
        """To the group's space."""
        return rprim.matrix if self.to_prim is None else self.to_prim @ rprim.matrix


class Entry:
    """What is known of an rprim. source: the prim that notices of changes name.

    inherited, wanted, geometry, geometry_log: what was read, for what, and its reports. inputs, result, log:
    what it came to with its materials. meshes: forms of the geometry with less in it, by what was taken away.
    varies: with time; None: not known yet. stale: has changed.
    """

    __slots__ = (
        "authored",
        "geometry",
        "geometry_log",
        "inherited",
        "inputs",
        "log",
        "meshes",
        "prim",
        "result",
        "source",
        "stale",
        "varies",
        "wanted",
    )

    def __init__(self, rprim: Rprim, inherited: tuple[Sdf.Path, ...]) -> None:
        self.prim = rprim.prim
        self.source = rprim.source
        self.authored: Authored = rprim.authored
        self.inherited = inherited
        self.wanted: Wanted | None = None
        self.geometry: Geometry | None = None
        self.geometry_log: Log = ()
        self.inputs: tuple[Any, ...] | None = None
        self.result: SyncedRprim | None = None
        self.log: Log = ()
        self.meshes: dict[Any, PreparedMesh] = {}
        self.varies: bool | None = None
        self.stale = False

    def might_vary(self) -> bool:
        """Whether another time may give another mesh."""
        if self.varies is None:
            self.varies = (
                bool(self.geometry and self.geometry.depends)
                or not self.authored.names.isdisjoint(_SPEEDS)
                or self._shape_varies()
                or any(might_vary(child) for child in self.prim.GetAllChildren() if child.IsA(UsdGeom.Subset))
            )
        return self.varies

    def _shape_varies(self) -> bool:
        """Whether anything of the prim but its place may vary."""
        names = (n for n in self.authored.names if not n.startswith("xformOp") and n != "visibility")
        attributes = (self.prim.GetAttribute(name) for name in names)
        return any(a and a.ValueMightBeTimeVarying() for a in attributes)


# What moves points, at another pace than that of samples.
_SPEEDS = ("velocities", "accelerations")


class RprimCache:
    """Entries by path and group. read: rprims whose geometry was read in this frame.

    aov_primvars: names of those that images show, whatever materials read.
    """

    def __init__(self) -> None:
        self.entries: dict[Any, Entry] = {}
        self.read = 0
        self.aov_primvars: frozenset[str] = frozenset()
        self._groups: set[Any] = set()
        self._inherited: dict[int, tuple[list[UsdGeom.Primvar], tuple[Sdf.Path, ...]]] = {}
        self._primvars: dict[int, dict[str, UsdGeom.Primvar]] = {}
        self._wanted: dict[Any, Wanted] = {}

    def begin(self) -> None:
        """Starts a frame."""
        self.read = 0
        self._inherited.clear()
        self._primvars.clear()
        self._wanted.clear()

    def clear(self) -> None:
        self.entries.clear()

    def keep_groups(self, keys: set[Any]) -> None:
        """Drops what is known of rprims in groups that are not there any more."""
        if not self._groups <= keys:
            self.entries = {key: entry for key, entry in self.entries.items() if key[1] in keys}
        self._groups = keys

    def entry(self, rprim: Rprim, group: Any) -> Entry:
        """The entry of an rprim in a group of this key, a new one where what is known is out of date."""
        known = rprim.entry
        if known is not None and not known.stale:
            found: Entry = known
            return found
        key = (rprim.path, group)
        inherited = self.inherited(rprim.inherited)
        entry = self.entries.get(key)
        if (
            entry is None
            or entry.stale
            or entry.authored is not rprim.authored
            or entry.inherited != inherited
            or entry.source != rprim.source
            or not entry.prim
        ):
            entry = self.entries[key] = Entry(rprim, inherited)
        rprim.entry = entry
        return entry

    def inherited(self, primvars: list[UsdGeom.Primvar]) -> tuple[Sdf.Path, ...]:
        """Paths of the attributes."""
        known = self._inherited.get(id(primvars))
        if known is None:
            paths = tuple(p.GetAttr().GetPath() for p in primvars)
            known = self._inherited[id(primvars)] = (primvars, paths)
        return known[1]

    def primvars(self, rprim: Rprim) -> Mapping[str, UsdGeom.Primvar]:
        """All primvars of an rprim by name, inherited ones included. Not to be written to."""
        shared = self._primvars.get(id(rprim.inherited))
        if shared is None:
            shared = {str(p.GetPrimvarName()): p for p in rprim.inherited}
            self._primvars[id(rprim.inherited)] = shared
        if not rprim.authored.own_primvars:
            return shared
        # As UsdGeomPrimvarsAPI::FindPrimvarsWithInheritance(), which looks for names again on every prim.
        found, attribute_of = shared.copy(), rprim.prim.GetAttribute
        for name, whole in rprim.authored.own_primvars:
            attribute = attribute_of(whole)
            if attribute and attribute.HasAuthoredValue():
                found[name] = UsdGeom.Primvar(attribute)
        return found

    def wanted(
        self, materials: tuple[BoundMaterial, ...], color: bool, fades: bool, given: Mapping[str, int]
    ) -> Wanted:
        """What materials read of a mesh. fades: displayOpacity is read as well. given: by instances."""
        key = materials, color, fades, tuple(given)
        found = self._wanted.get(key)
        if found is None:
            found = _wanted([m.data for m in materials], color)
            if fades:
                opacity = {OPACITY: found.primvars.get(OPACITY, 1)}
                found = replace(found, primvars={**found.primvars, **opacity})
            if self.aov_primvars:
                found = _with_aovs(found, self.aov_primvars)
            if given:
                found = replace(found, optional=found.optional | given.keys())
            self._wanted[key] = found
        return found


def _wanted(materials: Collection[MaterialData], color: bool) -> Wanted:
    """What all of the materials together read of a mesh."""
    primvars: dict[str, int] = {}
    needed: set[str] = set()
    for material in materials:
        for name, width in material.primvars.items():
            primvars[name] = max(width, primvars.get(name, 0))
        needed |= (material.texcoords | material.primvars.keys()) - material.optional
    texcoords = frozenset().union(*(m.texcoords for m in materials))
    optional = (texcoords | primvars.keys()) - needed
    return Wanted(texcoords, primvars, optional, color, any(m.transmits for m in materials))


def _with_aovs(wanted: Wanted, names: frozenset[str]) -> Wanted:
    """What images show besides, of meshes that have it."""
    missing = names - wanted.texcoords - wanted.primvars.keys() - {COLOR}
    return replace(
        wanted,
        primvars={**wanted.primvars, **dict.fromkeys(missing, 1)},
        optional=wanted.optional | missing,
        color=wanted.color or COLOR in names,
    )
