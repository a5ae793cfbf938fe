"""Primvars that instances give to what they place: per instance, or passed down to native instances."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom

from encore.adapters.context import SyncContext
from encore.adapters.primvars import FloatArray, is_texcoord, reject, width_of
from encore.adapters.shading_rate import is_rate

COLOR = "displayColor"
OPACITY = "displayOpacity"
# What meshes without a material show.
_SHOWN = frozenset((COLOR, OPACITY))
# What shaders of the user's own can ask for without naming it.
_ASKED = frozenset(("st",))


@dataclass(frozen=True)
class InstanceValues:
    """One primvar of n instances.

    values: (n, 4), missing floats are 0. width: floats that it has. wins: over what the meshes say themselves
    (per-instance primvars), and not only where they say nothing (inherited ones).
    """

    values: FloatArray
    width: int
    wins: bool


InstancePrimvars = Mapping[str, InstanceValues]


def read_point_primvars(
    instancer: Usd.Prim, count: int, read: Collection[str], context: SyncContext
) -> InstancePrimvars:
    """The primvars of a PointInstancer that differ between its `count` instances, by name.

    read: names that materials read; others are left out, as are shading rates. Constant primvars are not per
    instance: prototypes inherit them, like other prims. Of uniform ones, a single value is for all instances.
    Bad ones are reported and left out.
    """
    found: dict[str, InstanceValues] = {}
    for primvar in UsdGeom.PrimvarsAPI(instancer).GetPrimvarsWithAuthoredValues():
        name = str(primvar.GetPrimvarName())
        wanted = name in read or name in _SHOWN or name in _ASKED
        if not wanted or is_rate(primvar) or primvar.GetInterpolation() == UsdGeom.Tokens.constant:
            continue
        values = _numbers(primvar, context)
        if values is None:
            continue
        if primvar.GetInterpolation() == UsdGeom.Tokens.uniform and len(values) == 1:
            values = np.repeat(values, count, axis=0)
        if len(values) != count:
            reject(name, instancer.GetPath(), context, f"it has {len(values)} values for {count} instances")
        elif not np.isfinite(values).all():
            reject(name, instancer.GetPath(), context, "it holds infinite or NaN values")
        else:
            found[name] = InstanceValues(_four_wide(values), values.shape[1], True)
    return found


def inherited_value(
    primvar: UsdGeom.Primvar, read: Collection[str], time: Usd.TimeCode
) -> InstanceValues | None:
    """A constant primvar as one instance's, so that instances that differ in it share a prototype.

    None where it cannot be that: it has more than one value, or one that is no finite numbers. read: names
    that materials read; others are left out.
    """
    name = str(primvar.GetPrimvarName())
    if name not in _SHOWN and name not in read and not is_texcoord(primvar):
        return None
    width = width_of(primvar)
    if not width or primvar.GetElementSize() != 1:
        return None
    value = primvar.ComputeFlattened(time)
    if value is None:
        return None
    array = np.asarray(value, dtype=np.float32)
    if array.size != width:
        return None
    wide = np.zeros((1, 4), np.float32)
    wide[0, :width] = array.reshape(width)
    return InstanceValues(wide, width, False) if np.isfinite(wide).all() else None


def authored_above(primvar: UsdGeom.Primvar, root: Sdf.Path) -> bool:
    """Whether the primvar is that of the prim `root` or of one above it."""
    return bool(root.HasPrefix(primvar.GetAttr().GetPrimPath()))


def combine(
    outer: InstancePrimvars, inner: InstancePrimvars, outer_count: int, inner_count: int
) -> InstancePrimvars:
    """Primvars of all inner places at each of the outer ones in turn.

    Of one name, those that win over the meshes' own do so over those that do not, and else inner over outer.
    """
    if not outer and not inner:
        return inner
    spread = {n: replace(v, values=np.repeat(v.values, inner_count, axis=0)) for n, v in outer.items()}
    for name, values in inner.items():
        if name not in outer or values.wins or not outer[name].wins:
            spread[name] = replace(values, values=np.tile(values.values, (outer_count, 1)))
    return spread


def winning(primvars: InstancePrimvars) -> InstancePrimvars:
    """Without those that are inherited along the namespace."""
    return {name: values for name, values in primvars.items() if values.wins}


def chosen(primvars: InstancePrimvars, which: npt.NDArray[np.bool_]) -> InstancePrimvars:
    """Those of some of the instances."""
    return {name: replace(values, values=values.values[which]) for name, values in primvars.items()}


def given_widths(places: Iterable[InstancePrimvars]) -> dict[str, int]:
    """Floats of each primvar that any of the places gives; the fewest, where they differ."""
    widths: dict[str, int] = {}
    for primvars in places:
        for name, values in primvars.items():
            widths[name] = min(values.width, widths.get(name, values.width))
    return widths


def _four_wide(values: FloatArray) -> FloatArray:
    wide = np.zeros((len(values), 4), np.float32)
    wide[:, : values.shape[1]] = values
    return wide


def _numbers(primvar: UsdGeom.Primvar, context: SyncContext) -> FloatArray | None:
    """(n, width) values, without indices. None, and a report, where there are none of up to four floats."""
    name, path = str(primvar.GetPrimvarName()), primvar.GetAttr().GetPrimPath()
    width = width_of(primvar)
    if not width or primvar.GetElementSize() != 1:
        what = f"elementSize {primvar.GetElementSize()}" if width else f"type {primvar.GetTypeName()}"
        reject(name, path, context, f"it has {what}, and instances have up to four floats")
        return None
    raw: Any = primvar.Get(context.time)
    if raw is None:
        return None
    values: FloatArray = np.asarray(raw, dtype=np.float32).reshape(-1, width)
    if not primvar.IsIndexed():
        return values
    indices = np.asarray(primvar.GetIndices(context.time), dtype=np.int64)
    if indices.size and not (indices.min() >= 0 and indices.max() < len(values)):
        reject(name, path, context, f"an index is out of range: there are {len(values)} values")
        return None
    return np.ascontiguousarray(values[indices])
