"""Instancers → prototypes and the transforms at which they are placed.

Native instances (prims that share a USD prototype) and UsdGeom.PointInstancer, in one form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd, UsdGeom, UsdShade

from encore.adapters.context import SyncContext, to_matrix
from encore.adapters.matrix_motion import MatrixKeys, compose, inherit, point_instancer_keys
from encore.adapters.shading_rate import RateArray, read_point_rates, says_rate

Matrices = npt.NDArray[np.float64]  # (n, 4, 4), row vectors


@dataclass(frozen=True)
class PointPlacements:
    """Where a PointInstancer puts one of its prototypes, in the instancer's space.

    ids: per instance, and so are rates, where the instancer says some. motion: (n, k, 4, 4) keys from shutter
    open to close, where any of them moves.
    """

    root: Usd.Prim
    matrices: Matrices
    ids: npt.NDArray[np.int64]
    rates: RateArray | None
    motion: MatrixKeys | None = None


def read_point_instancer(instancer: UsdGeom.PointInstancer, context: SyncContext) -> list[PointPlacements]:
    """Every prototype with its visible instances, in the order of the prototypes. Broken parts are reported.

    The prototype root's own transform is part of the matrices.
    """
    time, path, reports = context.time, instancer.GetPath(), context.reports
    proto_indices = np.asarray(instancer.GetProtoIndicesAttr().Get(time) or (), dtype=np.int64)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    if not proto_indices.size or not targets:
        reports.add("empty instancer", "has no instances or no prototypes", path)
        return []
    transforms = instancer.ComputeInstanceTransformsAtTime(
        time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    matrices = np.array(transforms, dtype=np.float64).reshape(-1, 4, 4)
    if len(matrices) != len(proto_indices):
        reports.error(
            "bad instancer",
            f"is not rendered: it has {len(proto_indices)} protoIndices, but positions, orientations or "
            "scales of another length",
            path,
        )
        return []
    ids = np.asarray(instancer.GetIdsAttr().Get(time) or (), dtype=np.int64)
    if len(ids) != len(proto_indices):
        ids = np.arange(len(proto_indices), dtype=np.int64)
    rates = read_point_rates(instancer.GetPrim(), len(proto_indices), context)
    keys = point_instancer_keys(instancer, len(proto_indices), context)
    usable = _usable(instancer, proto_indices, matrices, len(targets), context)
    placements = []
    for index, target in enumerate(targets):
        chosen = usable & (proto_indices == index)
        root = context.stage.GetPrimAtPath(target)
        if not root:
            reports.error("missing prototype", f"prototype {target} does not exist", path)
        elif chosen.any():
            local = UsdGeom.XformCache(time).GetLocalTransformation(root)[0]
            own = to_matrix(local)
            moves = inherit(root, local, True, Gf.Matrix4d(1), None, context)
            motion = compose(
                own[None],
                moves.keys() if moves else None,
                matrices[chosen],
                None if keys is None else keys[chosen],
            )
            chosen_rates = None if rates is None else rates[chosen]
            placements.append(
                PointPlacements(root, own @ matrices[chosen], ids[chosen], chosen_rates, motion)
            )
    return placements


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
        report_singular(f"{instancer.GetPath()}", context)
    return usable & known & regular


def regular_matrices(matrices: Matrices) -> npt.NDArray[np.bool_]:
    """Per matrix: True where it is finite and can be inverted, whatever its scale."""
    linear = matrices[..., :3, :3]
    finite = np.isfinite(matrices).all(axis=(-2, -1))
    with np.errstate(all="ignore"):
        volume = np.linalg.norm(linear, axis=-1).prod(axis=-1)
        determinant = np.linalg.det(np.where(np.expand_dims(finite, (-2, -1)), linear, 0.0))
        regular: npt.NDArray[np.bool_] = finite & np.isfinite(volume) & (np.abs(determinant) > 1e-12 * volume)
    return regular


def report_singular(path: str, context: SyncContext) -> None:
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
    """

    binds: bool
    resets: bool
    rates: bool


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
        binds = resets = False
        # Prototypes of PointInstancers may be below an `over`.
        everything = Usd.PrimRange(prototype, Usd.PrimAllPrimsPredicate)
        rates = any(says_rate(prim) for prim in everything if prim != prototype)
        for prim in Usd.PrimRange(prototype):
            if prim == prototype:
                continue
            binds = binds or prim.HasAPI(UsdShade.MaterialBindingAPI)
            xformable = UsdGeom.Xformable(prim)
            resets = resets or bool(xformable and xformable.GetResetXformStack())
            if prim.IsInstance():
                nested = self.traits(prim.GetPrototype())
                binds, resets = binds or nested.binds, resets or nested.resets
                rates = rates or nested.rates
        return PrototypeTraits(binds, resets, rates)
