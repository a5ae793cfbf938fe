"""What applied API schemas ask for and do not get: reported, wherever it is authored."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from pxr import Usd

from encore.adapters.context import SyncContext


class _Unsupported(NamedTuple):
    """prefixes: of the names of attributes and relationships. message: a sentence without a full stop."""

    prefixes: tuple[str, ...]
    message: str


# By the name of the API schema. docs/coverage.md has them all.
_APIS = {
    "BackPlateAPI": _Unsupported(("backPlate:",), "back plates are not supported: none is shown"),
    "CoordSysAPI": _Unsupported(("coordSys:",), "coordinate systems are not supported: no shader sees them"),
    "LODRootAPI": _Unsupported(
        ("lod:",), "levels of detail are not supported: all that are visible are rendered"
    ),
    "MotionAPI": _Unsupported(
        ("motion:blurScale", "motion:velocityScale"),
        "scales of motion are not supported: motion is blurred as it is",
    ),
    "VisibilityAPI": _Unsupported(
        ("guideVisibility", "proxyVisibility", "renderVisibility"),
        "visibility by purpose is not supported: --purposes decides",
    ),
    "VolumeLightAPI": _Unsupported(("light:",), "volumes do not emit"),
}


def may_be_unsupported(applied: Iterable[str]) -> bool:
    """Whether report_unsupported() looks for any of these schemas."""
    return any(schema.partition(":")[0] in _APIS for schema in applied)


def report_unsupported(prim: Usd.Prim, applied: Iterable[str], context: SyncContext) -> None:
    """Reports what of a prim's applied schemas is authored and has no effect. applied: their names."""
    for schema in applied:
        found = _APIS.get(schema.partition(":")[0])
        if found is None:
            continue
        authored = prim.GetAuthoredPropertyNames()
        if any(name.startswith(found.prefixes) for name in authored):
            context.reports.add(f"unsupported {schema.partition(':')[0]}", found.message, prim.GetPath())
