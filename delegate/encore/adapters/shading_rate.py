"""Shading rates of prims and instances: `primvars:encore:shadingRate` and its forms for single layers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd, UsdGeom

from encore.adapters.context import SyncContext
from encore.adapters.primvars import SHADING_RATE, SHADING_RATES, reject

MAXIMUM = 256

# Samples per pixel in the direct, reflection and refraction layer; 0: not said here.
Rates = tuple[float, float, float]
NO_RATES: Rates = (0.0, 0.0, 0.0)
RateArray = npt.NDArray[np.float32]  # (n, 3): per instance

_PER_INSTANCE = ("uniform", "varying", "vertex")


def is_rate(primvar: UsdGeom.Primvar) -> bool:
    """True for the primvars that this module reads."""
    return primvar.GetPrimvarName() in SHADING_RATES


def says_rate(prim: Usd.Prim) -> bool:
    """Whether a rate is authored on the prim itself."""
    authored = prim.GetAuthoredPropertiesInNamespace("primvars:encore")
    return any(p.GetName().removeprefix("primvars:") in SHADING_RATES for p in authored)


def read_rates(primvars: Mapping[str, UsdGeom.Primvar], context: SyncContext) -> Rates:
    """What primvars, own and inherited ones, by name, say of a prim. Bad ones are reported and ignored."""
    if primvars.keys().isdisjoint(SHADING_RATES):
        return NO_RATES
    every, *layers = (_constant(primvars[n], context) if n in primvars else 0.0 for n in SHADING_RATES)
    direct, reflection, refraction = (layer or every for layer in layers)
    return direct, reflection, refraction


def read_native_rates(
    prim: Usd.Prim, primvars: Iterable[UsdGeom.Primvar], context: SyncContext
) -> tuple[Rates, Rates]:
    """Rates at a native instance: of all its rates, and of those authored on it, 0 in other layers.

    primvars: its rates, own and inherited ones.
    """
    found = {str(p.GetPrimvarName()): p for p in primvars}
    if not found:
        return NO_RATES, NO_RATES
    rates = read_rates(found, context)
    own = {name for name, primvar in found.items() if primvar.GetAttr().GetPrimPath() == prim.GetPath()}
    direct, reflection, refraction = (
        rate if SHADING_RATE in own or name in own else 0.0
        for rate, name in zip(rates, SHADING_RATES[1:], strict=True)
    )
    return rates, (direct, reflection, refraction)


def read_point_rates(instancer: Usd.Prim, count: int, context: SyncContext) -> RateArray | None:
    """Rates of the `count` instances of a PointInstancer, from constant or per-instance primvars on it.

    None where it says nothing. Bad primvars are reported and ignored.
    """
    if not says_rate(instancer):
        return None
    api = UsdGeom.PrimvarsAPI(instancer)
    every, *layers = (_per_instance(api.GetPrimvar(name), count, context) for name in SHADING_RATES)
    return np.stack([np.where(layer > 0, layer, every) for layer in layers], axis=-1)


def combine(
    outer: RateArray | None, inner: RateArray | None, outer_count: int, inner_count: int
) -> RateArray | None:
    """Rates of all inner places at each of the outer ones in turn: the outer rates win where above 0."""
    if inner is None:
        return outer if outer is None else np.repeat(outer, inner_count, axis=0)
    if outer is None:
        return np.tile(inner, (outer_count, 1))
    first, second = np.broadcast_arrays(outer[:, None], inner[None])
    return np.where(first > 0, first, second).reshape(-1, 3)


def _constant(primvar: UsdGeom.Primvar, context: SyncContext) -> float:
    if primvar.GetInterpolation() != UsdGeom.Tokens.constant:
        _reject(primvar, context, f"it has {primvar.GetInterpolation()} interpolation, not constant")
        return 0.0
    numbers = _numbers(primvar, 1, context)
    return 0.0 if numbers is None else float(numbers[0])


def _per_instance(primvar: UsdGeom.Primvar, count: int, context: SyncContext) -> RateArray:
    nothing = np.zeros(count, np.float32)
    if not primvar.HasAuthoredValue():
        return nothing
    if primvar.GetInterpolation() == UsdGeom.Tokens.constant:
        return nothing + np.float32(_constant(primvar, context))
    if primvar.GetInterpolation() not in _PER_INSTANCE:
        _reject(primvar, context, f"it has {primvar.GetInterpolation()} interpolation on a PointInstancer")
        return nothing
    numbers = _numbers(primvar, count, context)
    return nothing if numbers is None else numbers


def _numbers(primvar: UsdGeom.Primvar, count: int, context: SyncContext) -> RateArray | None:
    """The values, which must be `count` numbers in range. None where there are none, or bad ones."""
    value: Any = primvar.ComputeFlattened(context.time)
    if value is None:
        if primvar.Get(context.time) is not None:
            _reject(primvar, context, "its indices do not fit its values")
        return None
    values = np.asarray(value)
    if values.dtype.kind not in "fiu" or values.ndim > 1:
        _reject(primvar, context, f"it has type {primvar.GetTypeName()}, not float")
        return None
    if values.size != count:
        of = f"for {count} instances" if count != 1 else "where one is needed"
        _reject(primvar, context, f"it has {values.size} values {of}")
        return None
    bad = values[~((values >= 0) & (values <= MAXIMUM))]
    if bad.size:
        _reject(primvar, context, f"its value {bad.ravel()[0]:g} is not a number from 0 to {MAXIMUM}")
        return None
    return values.astype(np.float32).reshape(count)


def _reject(primvar: UsdGeom.Primvar, context: SyncContext, why: str) -> None:
    """Reports it where it is authored, which may be above the prim that inherits it."""
    reject(str(primvar.GetPrimvarName()), primvar.GetAttr().GetPrimPath(), context, why)
