"""Light and shadow linking: which lights light which prims, and are shadowed by which.

Core tells prims apart by link groups: prims that belong to the same of all restricted collections share one.
Collections (lightLink and shadowLink of UsdLuxLightAPI) that leave nothing out are not looked at, so that a
stage without linking has one group, and nothing is asked of any prim.
"""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Sdf, Usd, UsdLux

from encore.adapters.context import SyncContext

_LINKS = ("lightLink", "shadowLink")


class Links:
    """Link groups of all that the lights of a stage tell apart. lights: with UsdLuxLightAPI."""

    def __init__(self, lights: Iterable[Usd.Prim], context: SyncContext) -> None:
        self._context = context
        self._queries: list[Usd.CollectionMembershipQuery] = []
        self._number: dict[tuple[Sdf.Path, str], int] = {}  # of a light's collection among the queries
        self._groups: dict[tuple[bool, ...], int] = {}  # by membership in all queries
        self._known: dict[str, int] = {}
        self._above: set[Sdf.Path] = set()  # of what collections name, the prims above it
        for light in lights:
            for name in _LINKS:
                self._add(light, name)

    def __bool__(self) -> bool:
        """Whether any light is restricted."""
        return bool(self._queries)

    def group(self, path: str) -> int:
        """The link group of what is placed at a path; -1 where no light is restricted.

        Of instances in instancers the outermost instancer counts: its instances are one prim.
        """
        if not self._queries:
            return -1
        prim_path = path.partition("[")[0]
        if prim_path not in self._known:
            place = Sdf.Path(prim_path)
            members = tuple(bool(query.IsPathIncluded(place)) for query in self._queries)
            self._known[prim_path] = self._groups.setdefault(members, len(self._groups))
        return self._known[prim_path]

    def check_instance(self, path: str) -> None:
        """Reports collections that tell prims inside of an instance apart, which share one link group."""
        if not self._above:
            return
        place = Sdf.Path(path.partition("[")[0])
        if place in self._above:
            self._context.reports.add(
                "linking inside an instance",
                "lights are linked to prims inside of it: linking applies to instances as a whole",
                place,
            )

    def members(self, light: Usd.Prim, link: str) -> list[int]:
        """Per link group 1 where a light's collection (lightLink or shadowLink) has it; empty: it has all.

        To be asked when all groups are known.
        """
        number = self._number.get((light.GetPath(), link))
        return [] if number is None else [int(members[number]) for members in self._groups]

    def _add(self, light: Usd.Prim, name: str) -> None:
        key = light.GetPath(), name
        collection = Usd.CollectionAPI(light, name)
        if key in self._number or not _is_restricted(collection):
            return
        self._number[key] = len(self._queries)
        self._queries.append(collection.ComputeMembershipQuery())
        for relationship in (collection.GetIncludesRel(), collection.GetExcludesRel()):
            for target in relationship.GetForwardedTargets() if relationship else []:
                self._above.update(target.GetPrefixes()[:-1])


def is_light(prim: Usd.Prim) -> bool:
    """Whether a prim has collections for linking."""
    return bool(prim.HasAPI(UsdLux.LightAPI))


def _is_restricted(collection: Usd.CollectionAPI) -> bool:
    """False where a linking collection is as the schema has it, and has everything in it."""
    excludes, includes = collection.GetExcludesRel(), collection.GetIncludesRel()
    if collection.IsInExpressionMode():
        return True
    if excludes and excludes.GetTargets():
        return True
    root = collection.GetIncludeRootAttr()
    if not (root and root.Get()):
        # Without includes: an empty collection where one said so, and one that is not set up else.
        return bool(includes and includes.GetTargets()) or bool(root and root.HasAuthoredValue())
    rule = collection.GetExpansionRuleAttr()
    return bool(rule) and rule.Get() == Usd.Tokens.explicitOnly
