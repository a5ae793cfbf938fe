"""Instancers → prototypes and the transforms at which they are placed.

Native instances (prims that share a USD prototype) and UsdGeom.PointInstancer, in one form.
"""

from __future__ import annotations

from collections.abc import Collection, Sized
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd, UsdGeom, UsdShade

from encore.adapters import instance_primvars
from encore.adapters.context import BadValueError, SyncContext, array_of, to_matrix
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.matrix_motion import MatrixKeys, compose, inherit, point_instancer_keys
from encore.adapters.shading_rate import RateArray, read_point_rates, says_rate
from encore.adapters.skin_dependencies import binds_skeletons

Matrices = npt.NDArray[np.float64]  # (n, 4, 4), row vectors
_AT_ONCE = (
    1 << 14
)  # matrices that are looked at together: of millions, intermediate results need not be there at once


_SPEEDS = ("velocities", "accelerations", "angularVelocities")


@dataclass(frozen=True)
class PointPlacements:
    """Where a PointInstancer puts one of its prototypes, in the instancer's space.

    ids: per instance, and so are rates and primvars, where the instancer says some. motion: (n, k, 4, 4) keys
    from shutter open to close, where any of them moves.
    """

    root: Usd.Prim
    matrices: Matrices
    ids: npt.NDArray[np.int64]
    rates: RateArray | None
    motion: MatrixKeys | None = None
    primvars: InstancePrimvars = field(default_factory=dict)


def read_point_instancer(
    instancer: UsdGeom.PointInstancer, read: Collection[str], context: SyncContext
) -> list[PointPlacements]:
    """Every prototype with its visible instances, in the order of the prototypes. Broken parts are reported.

    read: names of primvars that materials read. The prototype root's own transform is part of the matrices.
    """
    time, path, reports = context.time, instancer.GetPath(), context.reports
    try:
        proto_indices = array_of("protoIndices", instancer.GetProtoIndicesAttr().Get(time), np.int64)
        ids = array_of("ids", instancer.GetIdsAttr().Get(time), np.int64)
    except BadValueError as error:
        reports.error("bad instancer", f"is not rendered: {error}", path)
        return []
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    if not proto_indices.size or not targets:
        reports.add("empty instancer", "has no instances or no prototypes", path)
        return []
    if _has_bad_lengths(instancer, len(proto_indices), context):
        return []
    transforms = instancer.ComputeInstanceTransformsAtTime(
        time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    matrices = np.asarray(transforms, dtype=np.float64).reshape(-1, 4, 4)
    if len(matrices) != len(proto_indices):
        reports.error("bad instancer", "is not rendered: its transforms cannot be computed", path)
        return []
    if len(ids) != len(proto_indices):
        ids = np.arange(len(proto_indices), dtype=np.int64)
    rates = read_point_rates(instancer.GetPrim(), len(proto_indices), context)
    primvars = instance_primvars.read_point_primvars(instancer.GetPrim(), len(proto_indices), read, context)
    keys = point_instancer_keys(instancer, len(proto_indices), context)
    usable = _usable(instancer, proto_indices, matrices, len(targets), context)
    placements = []
    for index, target in enumerate(targets):
        chosen = usable & (proto_indices == index)
        root = context.stage.GetPrimAtPath(target)
        if not root:
            reports.error("missing prototype", f"prototype {target} does not exist", path)
        elif chosen.any() and not (root.IsActive() and root.IsLoaded()):
            what = "inactive" if not root.IsActive() else "unloaded"
            reports.add(
                f"{what} prototype", f"prototype {target} is {what}: its instances are not rendered", path
            )
        elif chosen.any():
            local = UsdGeom.XformCache(time).GetLocalTransformation(root)[0]
            own = to_matrix(local)
            moves = inherit(root, local, True, Gf.Matrix4d(1), None, context)
            placed = matrices if chosen.all() else matrices[chosen]
            motion = compose(
                own[None], moves.keys() if moves else None, placed, None if keys is None else keys[chosen]
            )
            chosen_rates = None if rates is None else rates[chosen]
            placements.append(
                PointPlacements(
                    root,
                    product(own, placed),
                    ids[chosen],
                    chosen_rates,
                    motion,
                    instance_primvars.chosen(primvars, chosen),
                )
            )
    return placements


def _has_bad_lengths(instancer: UsdGeom.PointInstancer, count: int, context: SyncContext) -> bool:
    """Reports what has not one value per instance; True where it cannot be rendered for that.

    USD leaves speeds of a wrong length out, and reads beyond the end of what else is short.
    """
    found = {}
    for name in ("positions", "orientations", "orientationsf", "scales", *_SPEEDS):
        attribute = instancer.GetPrim().GetAttribute(name)
        value = attribute.Get(context.time) if attribute else None
        length = len(value) if isinstance(value, Sized) else 0
        if (length or name == "positions") and length != count:
            found[name] = f"{name} has {length} values for {count} instances"
    speeds = [text for name, text in found.items() if name in _SPEEDS]
    others = [text for name, text in found.items() if name not in _SPEEDS]
    path, reports = instancer.GetPath(), context.reports
    if others:
        reports.error("bad instancer", f"is not rendered: {' and '.join(others)}", path)
    elif speeds:
        reports.error("bad speeds", f"{' and '.join(speeds)}: they have no effect", path)
    return bool(others)


def _usable(
    instancer: UsdGeom.PointInstancer,
    proto_indices: npt.NDArray[np.int64],
    matrices: Matrices,
    prototypes: int,
    context: SyncContext,
) -> npt.NDArray[np.bool_]:
    """Instances that are neither masked (invisibleIds, inactiveIds) nor broken."""
    mask = instancer.ComputeMaskAtTime(context.time)
    usable = np.asarray(mask, dtype=bool) if mask else np.ones(len(proto_indices), dtype=bool)
    known = (proto_indices >= 0) & (proto_indices < prototypes)
    if not known.all():
        context.reports.error(
            "bad protoIndices",
            f"{np.count_nonzero(~known)} protoIndices are out of range: there are {prototypes} prototypes",
            instancer.GetPath(),
        )
    regular = regular_matrices(matrices)
    if not (regular | ~usable).all():
        report_singular(f"{instancer.GetPath()}", matrices[~regular & usable], context)
    return usable & known & regular


def product(left: Matrices, right: Matrices) -> Matrices:
    """left @ right; the same array, and no copy of what may be large, where the other is one identity."""
    if right.shape == (4, 4) and np.array_equal(right, np.eye(4)):
        return left
    if left.shape == (4, 4) and np.array_equal(left, np.eye(4)):
        return right
    return left @ right


def regular_matrices(matrices: Matrices) -> npt.NDArray[np.bool_]:
    """Per matrix: True where it is finite and can be inverted, whatever its scale."""
    if len(matrices) > _AT_ONCE:
        starts = range(0, len(matrices), _AT_ONCE)
        return np.concatenate([regular_matrices(matrices[i : i + _AT_ONCE]) for i in starts])
    linear = matrices[..., :3, :3]
    finite = np.isfinite(matrices).all(axis=(-2, -1))
    with np.errstate(all="ignore"):
        volume = np.linalg.norm(linear, axis=-1).prod(axis=-1)
        determinant = np.linalg.det(np.where(np.expand_dims(finite, (-2, -1)), linear, 0.0))
        regular: npt.NDArray[np.bool_] = finite & np.isfinite(volume) & (np.abs(determinant) > 1e-12 * volume)
    return regular


def report_singular(path: str, matrices: Matrices, context: SyncContext) -> None:
    """Reports matrices that are not regular, of what is at a path."""
    if not np.isfinite(matrices).all():
        context.reports.error(
            "transform not finite",
            "its transform holds infinite or NaN values, so nothing is visible",
            path,
        )
        return
    context.reports.add(
        "singular transform",
        "its transform cannot be inverted (a scale of 0, for one), so nothing is visible",
        path,
    )


@dataclass(frozen=True)
class PrototypeTraits:
    """What a USD prototype holds that decides how its instances may share it.

    binds: a material is bound inside, so that what instances inherit may matter per mesh.
    resets: a transform inside ignores the instance's, so that nothing can be shared.
    rates: a shading rate is authored inside, which wins over those that the instance inherits.
    skins: something is bound to a skeleton, so that what instances inherit may pose it.
    """

    binds: bool
    resets: bool
    rates: bool
    skins: bool


class PrototypeScanner:
    """Looks through each native prototype once, nested ones included."""

    def __init__(self) -> None:
        self._traits: dict[Any, PrototypeTraits] = {}

    def traits(self, prototype: Usd.Prim) -> PrototypeTraits:
        path = prototype.GetPath()
        if path not in self._traits:
            self._traits[path] = self._scan(prototype)
        return self._traits[path]

    def _scan(self, prototype: Usd.Prim) -> PrototypeTraits:
        binds = resets = skins = False
        # Prototypes of PointInstancers may be below an `over`.
        everything = Usd.PrimRange(prototype, Usd.PrimAllPrimsPredicate)
        rates = any(says_rate(prim) for prim in everything if prim != prototype)
        for prim in Usd.PrimRange(prototype):
            skins = skins or binds_skeletons(prim)
            if prim == prototype:
                continue
            binds = binds or prim.HasAPI(UsdShade.MaterialBindingAPI)
            xformable = UsdGeom.Xformable(prim)
            resets = resets or bool(xformable and xformable.GetResetXformStack())
            if prim.IsInstance():
                nested = self.traits(prim.GetPrototype())
                binds, resets = binds or nested.binds, resets or nested.resets
                rates, skins = rates or nested.rates, skins or nested.skins
        return PrototypeTraits(binds, resets, rates, skins)
