"""Transforms that vary while the shutter is open, and transforms in transforms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd, UsdGeom

from encore.adapters.context import SyncContext, to_matrix
from encore.adapters.motion import STILL, breaks_of, interpolate, resample, uniform

Matrices = npt.NDArray[np.float64]  # (n, 4, 4), row vectors
MatrixKeys = npt.NDArray[np.float64]  # (n, keys, 4, 4), at uniform times from shutter open to close


@dataclass(eq=False)
class Mover:
    """A transform that varies: the local one of a prim, in what it is placed in.

    offset: transforms of still prims between it and `parent`, or the group's space. breaks: stage times of
    USD's samples in the shutter interval, its ends included, of this prim and of its parents.
    """

    local: Callable[[float], Gf.Matrix4d]
    offset: Gf.Matrix4d
    parent: Mover | None
    breaks: tuple[float, ...]
    shutter: tuple[float, float]
    _known: dict[float, Gf.Matrix4d] = field(default_factory=dict)
    _keys: Matrices | None = None
    _sampled: bool = False

    def at(self, time: float) -> Gf.Matrix4d:
        """To the group's space, at a stage time."""
        if time not in self._known:
            matrix = self.local(time) * self.offset
            self._known[time] = matrix * self.parent.at(time) if self.parent else matrix
        return self._known[time]

    def keys(self) -> Matrices | None:
        """(k, 4, 4) from shutter open to close; None where it does not move."""
        if not self._sampled:
            opens, closes = self.shutter
            fractions = [(t - opens) / (closes - opens) for t in self.breaks]
            self._keys = resample(self._sample, fractions)
            self._sampled = True
        return self._keys

    def _sample(self, fractions: npt.NDArray[np.float64]) -> Matrices:
        opens, closes = self.shutter
        return np.array([to_matrix(self.at(float(opens + f * (closes - opens)))) for f in fractions])


@dataclass(frozen=True)
class Moving:
    """What a prim inherits of motion. offset: transforms of still prims below the mover."""

    mover: Mover
    offset: Gf.Matrix4d

    def keys(self) -> MatrixKeys | None:
        """(1, k, 4, 4) to the group's space; None where it does not move."""
        keys = self.mover.keys()
        return None if keys is None else (to_matrix(self.offset) @ keys)[None]


def inherit(
    prim: Usd.Prim,
    local: Gf.Matrix4d,
    resets: bool,
    above: Gf.Matrix4d,
    moving: Moving | None,
    context: SyncContext,
) -> Moving | None:
    """The motion of a prim, from that of its parent.

    local: at the frame's time. above: the parent's matrix to the group's space then.
    """
    if context.shutter is None:
        return None
    if resets:
        above, moving = Gf.Matrix4d(1), None
    xformable = UsdGeom.Xformable(prim)
    if xformable and xformable.TransformMightBeTimeVarying():
        offset = moving.offset if moving else above
        parent = moving.mover if moving else None
        times = xformable.GetTimeSamplesInInterval(Gf.Interval(*context.shutter))
        breaks = {*context.shutter, *times, *(parent.breaks if parent else ())}
        mover = Mover(local_transform(xformable), offset, parent, tuple(sorted(breaks)), context.shutter)
        return Moving(mover, Gf.Matrix4d(1))
    return Moving(moving.mover, local * moving.offset) if moving else None


def world_keys(prim: Usd.Prim, context: SyncContext) -> Matrices | None:
    """(k, 4, 4) local to world of a prim from shutter open to close; None where it does not move."""
    if context.shutter is None:
        return None
    cache = UsdGeom.XformCache(context.time)
    moving: Moving | None = None
    above = Gf.Matrix4d(1)
    for path in prim.GetPath().GetPrefixes():
        ancestor = context.stage.GetPrimAtPath(path)
        local, resets = cache.GetLocalTransformation(ancestor)
        moving = inherit(ancestor, local, resets, above, moving, context)
        above = local if resets else local * above
    keys = moving.keys() if moving else None
    return None if keys is None else keys[0]


def local_transform(xformable: UsdGeom.Xformable) -> Callable[[float], Gf.Matrix4d]:
    """The local transform by stage time: each op as USD interpolates it, but matrices by their parts.

    USD interpolates a matrix number by number, which shrinks what turns.
    """
    ops = xformable.GetOrderedXformOps()
    if not any(op.GetOpType() == UsdGeom.XformOp.TypeTransform and op.MightBeTimeVarying() for op in ops):
        return lambda time: xformable.GetLocalTransformation(Usd.TimeCode(time))
    factors = [_op_transform(op) for op in ops]

    def local(time: float) -> Gf.Matrix4d:
        matrix = Gf.Matrix4d(1)
        for factor in factors:
            matrix = factor(time) * matrix
        return matrix

    return local


def _op_transform(op: UsdGeom.XformOp) -> Callable[[float], Gf.Matrix4d]:
    attribute = op.GetAttr()
    if op.GetOpType() != UsdGeom.XformOp.TypeTransform or not op.MightBeTimeVarying():
        return lambda time: op.GetOpTransform(Usd.TimeCode(time))

    def transform(time: float) -> Gf.Matrix4d:
        bracket = attribute.GetBracketingTimeSamples(time)
        low, high = bracket if bracket else (time, time)
        if low == high:
            return op.GetOpTransform(Usd.TimeCode(time))
        first, second = (op.GetOpTransform(Usd.TimeCode(t)) for t in (low, high))
        between = blend(to_matrix(first), to_matrix(second), (time - low) / (high - low))
        return op.GetOpTransform(Usd.TimeCode(time)) if between is None else Gf.Matrix4d(between.tolist())

    return transform


def blend(first: Matrices, second: Matrices, weight: float) -> Matrices | None:
    """Between two matrices: rotations by the shortest turn, stretches and translations linearly.

    Each is stretch · rotation (polar decomposition). None where one is singular or only one mirrors.
    """
    parts0, parts1 = _polar(first[:3, :3]), _polar(second[:3, :3])
    if parts0 is None or parts1 is None:
        return None
    (stretch0, turn0), (stretch1, turn1) = parts0, parts1
    if np.linalg.det(turn0) * np.linalg.det(turn1) < 0:
        return None
    # The turn from one to the other, of which a part is made. A mirror is in both, and cancels.
    step = Gf.Matrix3d(*(turn0.T @ turn1).ravel().tolist()).ExtractRotation()
    partial = np.array(Gf.Matrix3d(Gf.Rotation(step.axis, step.angle * weight)))
    result = (1 - weight) * first + weight * second
    result[:3, :3] = ((1 - weight) * stretch0 + weight * stretch1) @ turn0 @ partial
    return result


def _polar(linear: Matrices) -> tuple[Matrices, Matrices] | None:
    """(stretch, turn) with linear = stretch · turn, the turn orthogonal; None for what is singular."""
    if not np.isfinite(linear).all():
        return None
    u, sizes, v = np.linalg.svd(linear)
    if sizes[-1] <= 1e-9 * sizes[0]:
        return None
    return (u * sizes) @ u.T, u @ v


# Transforms in transforms


def compose(
    inner: Matrices, inner_keys: MatrixKeys | None, outer: Matrices, outer_keys: MatrixKeys | None
) -> MatrixKeys | None:
    """Motion of inner places at each of the outer ones in turn, as inner @ outer; None where none moves."""
    if inner_keys is None and outer_keys is None:
        return None
    if inner_keys is None:
        result = inner[None, :, None] @ outer_keys[:, None]  # type: ignore[index]
    elif outer_keys is None:
        result = inner_keys[None] @ outer[:, None, None]
    else:
        return _compose_moving(inner_keys, outer_keys)
    return np.ascontiguousarray(result.reshape(-1, *result.shape[2:]))


def _compose_moving(inner: MatrixKeys, outer: MatrixKeys) -> MatrixKeys | None:
    def sample(times: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
        first, second = (interpolate(k.swapaxes(0, 1), times) for k in (inner, outer))
        product = first[:, None] @ second[:, :, None]  # (times, outer, inner, 4, 4)
        return product.reshape(len(times), -1, 4, 4)

    breaks = {*uniform(inner.shape[1]).tolist(), *uniform(outer.shape[1]).tolist()}
    keys = resample(sample, sorted(breaks))
    return None if keys is None else np.ascontiguousarray(keys.swapaxes(0, 1))


def point_instancer_keys(
    instancer: UsdGeom.PointInstancer, count: int, context: SyncContext
) -> MatrixKeys | None:
    """(n, k, 4, 4) of all instances, in the instancer's space; None where they stay.

    By USD's rules: velocities and angular velocities where there are any, else samples.
    """
    if context.shutter is None:
        return None
    sampled = (
        instancer.GetPositionsAttr(),
        instancer.GetOrientationsAttr(),
        instancer.GetOrientationsfAttr(),
    )
    speeds = (instancer.GetVelocitiesAttr(), instancer.GetAngularVelocitiesAttr())
    attributes = [a for a in (*sampled, instancer.GetScalesAttr()) if a and a.ValueMightBeTimeVarying()]
    if not attributes and not any(a.HasAuthoredValue() for a in speeds):
        return None
    opens, closes = context.shutter
    # USD reads beyond the end of these where they are short.
    times = [opens + f * (closes - opens) for f in breaks_of(attributes, context.shutter)]
    unchecked = (*sampled[1:], instancer.GetScalesAttr())
    whole = all(
        len(attribute.Get(Usd.TimeCode(t)) or ()) in (0, count)
        for attribute in unchecked
        if attribute in attributes
        for t in times
    )

    def sample(fractions: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
        nonlocal whole
        times = [Usd.TimeCode(float(opens + f * (closes - opens))) for f in fractions]
        found = instancer.ComputeInstanceTransformsAtTimes(
            times, context.time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
        if len(found) != len(times) or any(len(f) != count for f in found):
            whole = False
            return np.broadcast_to(np.eye(4), (len(times), count, 4, 4))
        return np.array(found, dtype=np.float64).reshape(len(times), count, 4, 4)

    keys = resample(sample, breaks_of(attributes, context.shutter)) if whole else None
    if not whole:
        context.reports.add(
            "instances that come or go",
            "its number of instances changes while the shutter is open: they are not blurred by motion",
            instancer.GetPath(),
        )
        return None
    return None if keys is None else np.ascontiguousarray(keys.swapaxes(0, 1))


def moving_instances(keys: MatrixKeys) -> npt.NDArray[np.bool_]:
    """Per instance: whether it moves at all."""
    moved = np.abs(keys - keys[:, :1]).max(axis=(1, 2, 3))
    size = np.abs(keys).max(axis=(1, 2, 3))
    moves: npt.NDArray[np.bool_] = moved > STILL * size
    return moves
