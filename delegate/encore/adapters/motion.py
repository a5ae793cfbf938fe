"""Motion while the shutter is open: USD's own samples → keys at uniform times, as the tracer takes them.

Between keys the tracer interpolates linearly. A motion gets as few keys as keep that within TOLERANCE of the
distance that it covers; what stays where it is gets none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd, UsdGeom

from encore.adapters.context import SyncContext

Points = npt.NDArray[np.float32]  # (keys, n, 3)
# Fractions of the shutter interval (m,) → what moves, (m, …).
Sampler = Callable[[npt.NDArray[np.float64]], npt.NDArray[Any]]

MOST_KEYS = 129  # kMaxMotionKeys of core/scene/scene.h
TOLERANCE = 1e-3  # of linear interpolation between keys, relative to the distance moved
# Changes below this, relative to the size of what changes, are none.
STILL = 1e-10
_MOST_NUMBERS = 1 << 27  # of all keys of one deforming mesh
_SEGMENTS = (*range(1, 17), 20, 24, 32, 40, 48, 64, 80, 96, 128)
# Where to look between two of USD's samples: nowhere that whole turns or even keys would hide.
_BETWEEN = (0.211, 0.5, 0.783)


def stage_shutter(
    time: Usd.TimeCode, interval: tuple[float, float], stage: Usd.Stage
) -> tuple[float, float] | None:
    """SyncContext.shutter for a frame at `time`. interval: relative to it, in frames.

    None where the shutter is not open for any time, where nothing on the stage has samples, and where the
    stage holds them instead of interpolating.
    """
    opens, closes = interval
    held = stage.GetInterpolationType() == Usd.InterpolationTypeHeld
    if time.IsDefault() or not closes > opens or held or not _is_animated(stage):
        return None
    return time.GetValue() + opens, time.GetValue() + closes


def _is_animated(stage: Usd.Stage) -> bool:
    """False where no value on the stage can vary; found from its layers, without a look at prims."""
    # Splines are no samples, and layers of value clips may not be open yet: a range of frames tells of them.
    layers = stage.GetUsedLayers(False)
    return any(layer.HasEndTimeCode() or layer.ListAllTimeSamples() for layer in layers)


def uniform(keys: int) -> npt.NDArray[np.float64]:
    """Times of keys, as fractions of the shutter interval."""
    return np.linspace(0.0, 1.0, keys)


def interpolate(keys: npt.NDArray[Any], times: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    """Keys (k, …) at fractions of the shutter interval, linearly, as the tracer does."""
    place = times * (len(keys) - 1)
    first = np.minimum(place.astype(np.int64), len(keys) - 2)
    weight = (place - first).reshape(-1, *(1,) * (keys.ndim - 1))
    return keys[first] * (1 - weight) + keys[first + 1] * weight


def resample(
    sampler: Sampler, breaks: Sequence[float], *, matrices: bool = True, linear: bool = False
) -> npt.NDArray[Any] | None:
    """Keys of a motion, (k, …), 2 ≤ k ≤ MOST_KEYS; None where nothing moves.

    breaks: fractions of the shutter interval at which the motion may change its course, 0 and 1 among them.
    linear: it is linear between them. Of matrices, (…, 4, 4), each row keeps to TOLERANCE of the distance
    that it moves itself; points, (…, 3), keep to that of the one that moves furthest.
    """
    checked = np.array(breaks if linear else _with_between(breaks))
    truth = sampler(checked)
    moved = _furthest(truth - truth[:1], matrices)
    least = STILL * _furthest(truth, matrices)
    if not _exceeds(moved, least):
        return None
    allowed = np.maximum(TOLERANCE * moved, least)
    keys = None
    # Large meshes get no more keys than their samples ask for, and memory allows.
    most = _SEGMENTS[-1] if matrices else max(len(breaks) - 1, _MOST_NUMBERS // max(truth[0].size, 1))
    for segments in (s for s in _SEGMENTS if s == _SEGMENTS[0] or s <= most):
        keys = sampler(uniform(segments + 1))
        if _exceeds(_furthest(interpolate(keys, checked) - truth, matrices), allowed):
            continue
        middles = (np.arange(segments) + 0.5) / segments
        off = None if linear else interpolate(keys, middles) - sampler(middles)
        if off is None or not _exceeds(_furthest(off, matrices), allowed):
            break
    return keys


def _with_between(breaks: Sequence[float]) -> list[float]:
    between = [a + f * (b - a) for a, b in pairwise(breaks) for f in _BETWEEN]
    return sorted({*breaks, *between})


def _furthest(rows: npt.NDArray[Any], matrices: bool) -> npt.NDArray[np.float64]:
    """Longest vector over time: per row of matrices, or of all points."""
    lengths = np.linalg.norm(rows[..., :3].astype(np.float64, copy=False), axis=-1)
    longest: npt.NDArray[np.float64] = lengths.max(axis=0) if matrices else np.asarray(lengths.max(initial=0))
    return longest


def _exceeds(distances: npt.NDArray[np.float64], bounds: npt.NDArray[np.float64]) -> bool:
    """Whether any distance is beyond its bound. What is not finite does not move."""
    return bool((np.nan_to_num(distances, nan=0.0, posinf=0.0) > bounds).any())


def breaks_of(attributes: Sequence[Usd.Attribute], shutter: tuple[float, float]) -> list[float]:
    """Fractions of the shutter interval at which attributes have samples, and its ends."""
    opens, closes = shutter
    times = {t for a in attributes for t in a.GetTimeSamplesInInterval(Gf.Interval(opens, closes))}
    return sorted({0.0, 1.0, *((t - opens) / (closes - opens) for t in times)})


def point_motion(prim: Usd.Prim, context: SyncContext) -> Points | None:
    """Points of a mesh at uniform times from shutter open to close; None where they stay.

    Linear between USD's samples; by velocities and accelerations, as USD computes them, where there is one
    sample, or where the topology changes. Where it changes without velocities, that is reported.
    """
    mesh = UsdGeom.PointBased(prim)
    if context.shutter is None or not mesh:
        return None
    attribute = mesh.GetPointsAttr()
    velocities = mesh.GetVelocitiesAttr()
    varies = attribute.ValueMightBeTimeVarying()
    if not varies and not (velocities and velocities.HasAuthoredValue()):
        return None
    if varies and _keeps_topology(mesh, context):
        keys = _value_keys(attribute, context)
        if keys is not None:
            return keys if keys.shape[0] else None
    if velocities and velocities.HasAuthoredValue():
        return _velocity_keys(mesh, context)
    context.reports.add(
        "changing topology",
        "its topology changes while the shutter is open, and it has no velocities: it is rendered as at the "
        "frame's time, without motion blur of its points",
        prim.GetPath(),
    )
    return None


def normal_motion(prim: Usd.Prim, context: SyncContext, keys: int) -> Points | None:
    """Values of a mesh's normals at `keys` uniform times, those of point_motion(); None where they stay.

    primvars:normals before normals. None as well where their number changes.
    """
    mesh = UsdGeom.PointBased(prim)
    if context.shutter is None or keys < 2:
        return None
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    attribute = primvar.GetAttr() if primvar and primvar.HasAuthoredValue() else mesh.GetNormalsAttr()
    if not attribute or not attribute.ValueMightBeTimeVarying():
        return None
    if primvar and primvar.IsIndexed() and primvar.GetIndicesAttr().ValueMightBeTimeVarying():
        return None
    times = breaks_of([attribute], context.shutter)
    values = _read(attribute, times, context.shutter)
    return None if values is None else _along(values, times, uniform(keys)).astype(np.float32)


def _read(
    attribute: Usd.Attribute, fractions: Sequence[float], shutter: tuple[float, float]
) -> npt.NDArray[np.float32] | None:
    """(m, n, 3) values at fractions of the shutter interval; None where their number changes."""
    opens, closes = shutter
    values = [attribute.Get(Usd.TimeCode(opens + f * (closes - opens))) for f in fractions]
    if any(v is None for v in values) or len({len(v) for v in values}) != 1:
        return None
    return np.stack([np.asarray(v, dtype=np.float32).reshape(-1, 3) for v in values])


def _along(
    values: npt.NDArray[Any], times: Sequence[float], wanted: npt.NDArray[np.float64]
) -> npt.NDArray[Any]:
    """Values (m, …), given at `times`, linearly at the wanted times."""
    second = np.clip(np.searchsorted(times, wanted, side="left"), 1, len(times) - 1)
    known = np.asarray(times)
    weight = (wanted - known[second - 1]) / (known[second] - known[second - 1])
    weight = weight.reshape(-1, *(1,) * (values.ndim - 1))
    return values[second - 1] * (1 - weight) + values[second] * weight


def _value_keys(attribute: Usd.Attribute, context: SyncContext) -> Points | None:
    """Keys of an attribute's samples: none of them (0, …) where it stays; None where numbers change."""
    assert context.shutter is not None
    times = breaks_of([attribute], context.shutter)
    values = _read(attribute, times, context.shutter)
    now = attribute.Get(context.time)
    if values is None or now is None or len(now) != values.shape[1]:
        return None
    keys = resample(lambda wanted: _along(values, times, wanted), times, matrices=False, linear=True)
    return values[:0] if keys is None else np.ascontiguousarray(keys, dtype=np.float32)


# What says which points belong together: of meshes, curves and points. Points go by their ids.
_TOPOLOGY = ("faceVertexCounts", "faceVertexIndices", "curveVertexCounts", "ids")


def _keeps_topology(mesh: UsdGeom.PointBased, context: SyncContext) -> bool:
    """Whether faces, curves or points are those of the frame's time while the shutter is open."""
    assert context.shutter is not None
    opens, closes = context.shutter
    for attribute in (mesh.GetPrim().GetAttribute(name) for name in _TOPOLOGY):
        if not attribute or not attribute.ValueMightBeTimeVarying():
            continue
        now = attribute.Get(context.time)
        times = [opens, closes, *attribute.GetTimeSamplesInInterval(Gf.Interval(opens, closes))]
        if attribute.GetName() == "ids":  # of the samples that points are on their way to
            times += [t for at in (opens, closes) for t in attribute.GetBracketingTimeSamples(at)]
        if any(attribute.Get(Usd.TimeCode(t)) != now for t in times):
            return False
    return True


def _velocity_keys(mesh: UsdGeom.PointBased, context: SyncContext) -> Points | None:
    assert context.shutter is not None
    opens, closes = context.shutter
    now = mesh.GetPointsAttr().Get(context.time)
    count = len(now) if now is not None else 0

    def sample(fractions: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
        times = [Usd.TimeCode(float(opens + f * (closes - opens))) for f in fractions]
        found = mesh.ComputePointsAtTimes(times, context.time)
        if len(found) != len(times) or any(len(f) != count for f in found):
            return np.broadcast_to(np.asarray(now, dtype=np.float32), (len(times), count, 3))
        return np.stack([np.asarray(f, dtype=np.float32) for f in found])

    breaks = breaks_of([mesh.GetPointsAttr(), mesh.GetVelocitiesAttr()], context.shutter)
    keys = resample(sample, breaks, matrices=False)
    return None if keys is None else np.ascontiguousarray(keys, dtype=np.float32)
