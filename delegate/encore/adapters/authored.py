"""What is authored on a prim, by name: found once for all prims that have the same properties."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Usd, UsdGeom


class Authored:
    """Names of a prim's properties that have opinions, and what of them is asked most."""

    __slots__ = (
        "binds_collections",
        "names",
        "own_primvars",
        "primvars",
        "purpose",
        "transform",
        "visibility",
    )

    def __init__(self, names: Iterable[str]) -> None:
        self.names = frozenset(names)
        self.visibility = "visibility" in self.names
        self.purpose = "purpose" in self.names
        self.transform = "xformOpOrder" in self.names
        self.primvars = any(n.startswith("primvars:") for n in self.names)
        # Of what may be primvars, names without the prefix, and whole ones.
        is_primvar = UsdGeom.Primvar.IsValidPrimvarName
        self.own_primvars = tuple(
            (n.removeprefix("primvars:"), n) for n in sorted(self.names) if is_primvar(n)
        )
        self.binds_collections = any(n.startswith("material:binding:collection") for n in self.names)


def names_from_clips(prim: Usd.Prim) -> tuple[str, ...]:
    """Names of a prim's attributes that have values from value clips, and no opinions elsewhere."""
    found = (a for a in prim.GetAttributes() if not a.IsAuthored())
    return tuple(a.GetName() for a in found if a.HasAuthoredValue())
