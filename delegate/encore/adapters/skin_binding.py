"""Bindings of prims to skeletons and blend shapes, checked: who is skinned, by what, and why not."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from encore.adapters.blend_shapes import read_blend_shapes
from encore.adapters.context import SyncContext, to_matrix
from encore.adapters.skin_dependencies import BLEND_SHAPES, INFLUENCES, inherited_target, outermost_root
from encore.adapters.skinning import Influences, Relative, Skin

_INFLUENCES = INFLUENCES.removeprefix("primvars:")
_PROXIES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)


class _BrokenSkinError(Exception):
    """Why a prim is not skinned."""


@dataclass
class Skeletons:
    """Bindings of all SkelRoots that were asked for. Of a stage as it is: to be made anew after edits."""

    _bindings: dict[Sdf.Path, dict[Sdf.Path, tuple[UsdSkel.SkeletonQuery, UsdSkel.SkinningQuery]]] = field(
        default_factory=dict
    )

    def binding(
        self, root: UsdSkel.Root, prim: Usd.Prim
    ) -> tuple[UsdSkel.SkeletonQuery, UsdSkel.SkinningQuery] | None:
        """The skeleton that a prim below a SkelRoot is bound to, and how; None where it is to none."""
        path = root.GetPath()
        if path not in self._bindings:
            cache = UsdSkel.Cache()  # one each: instances of a root share prims, but not animations
            cache.Populate(root, _PROXIES)
            self._bindings[path] = {
                skinned.GetPrim().GetPath(): (cache.GetSkelQuery(binding.GetSkeleton()), skinned)
                for binding in cache.ComputeSkelBindings(root, _PROXIES)
                for skinned in binding.GetSkinningTargets()
            }
        return self._bindings[path].get(prim.GetPath())


def may_be_skinned(names: Collection[str], primvars: Collection[str]) -> bool:
    """names: of authored properties of a prim. primvars: of its primvars, inherited ones included."""
    return _INFLUENCES in primvars or BLEND_SHAPES in names


def read_skin(prim: Usd.Prim, points: int, context: SyncContext) -> Skin | None:
    """How a prim of `points` points is posed; None, and a report, where nothing poses it.

    points: 1 for what has none, and follows joints as a whole.
    """
    root = outermost_root(prim)
    path, reports = prim.GetPath(), context.reports
    if root is None:
        reports.add(
            "skinning outside of a SkelRoot",
            "joints and blend shapes have no effect outside of a SkelRoot: it is rendered at rest",
            path,
        )
        return None
    try:
        return _read_bound(prim, root, points, context)
    except _BrokenSkinError as error:
        reports.error("bad skinning", f"is rendered at rest: {error}", path)
        return None


def _read_bound(prim: Usd.Prim, root: UsdSkel.Root, points: int, context: SyncContext) -> Skin | None:
    skeletons: Skeletons = context.memo.setdefault(Skeletons, Skeletons())
    found = skeletons.binding(root, prim)
    if found is None:
        raise _BrokenSkinError(_why_unbound(prim))
    skeleton, query = found
    path, _ = inherited_target(prim, "skel:skeleton")
    if not skeleton or path is None:
        raise _BrokenSkinError(f"skeleton {path} has no valid joints")
    placed = context.stage.GetPrimAtPath(path)  # the query's own may be part of a prototype, and be nowhere
    _check_animation(placed, context)
    influences = None
    if query.GetJointIndicesPrimvar() or query.GetJointWeightsPrimvar():
        influences = _read_influences(query, skeleton, points, context.time)
        _check_pose(skeleton, influences, query, context.time)
    shapes = read_blend_shapes(query, skeleton, points, context)
    if influences is None and shapes is None:
        return None
    return Skin(prim, skeleton, query, shapes, influences, Relative(placed, prim, context.time))


def _why_unbound(prim: Usd.Prim) -> str:
    if not prim.HasAPI(UsdSkel.BindingAPI) and not _has_binding_above(prim):
        return "SkelBindingAPI is not applied to it"
    target, _ = inherited_target(prim, "skel:skeleton")
    if target is None:
        return "no skel:skeleton is bound to it or above it"
    if not prim.GetStage().GetPrimAtPath(target):
        return f"skel:skeleton {target} does not exist"
    if not prim.GetStage().GetPrimAtPath(target).IsA(UsdSkel.Skeleton):
        return f"skel:skeleton {target} is no Skeleton"
    above = prim.GetParent()
    while above and not above.IsPseudoRoot():
        if not above.IsA(UsdGeom.Imageable):
            return f"{above.GetPath()} above it is not Imageable, and hides its binding from UsdSkel"
        above = above.GetParent()
    return f"its binding to {target} cannot be used"


def _has_binding_above(prim: Usd.Prim) -> bool:
    while prim and not prim.IsPseudoRoot():
        if prim.HasAPI(UsdSkel.BindingAPI):
            return True
        prim = prim.GetParent()
    return False


def _check_animation(skeleton: Usd.Prim, context: SyncContext) -> None:
    """Reports an animation that does not exist: the skeleton is at rest."""
    target, _ = inherited_target(skeleton, "skel:animationSource")
    found = context.stage.GetPrimAtPath(target) if target is not None else None
    if target is not None and not (found and UsdSkel.IsSkelAnimationPrim(found)):
        context.reports.error(
            "bad skeleton animation",
            f"skel:animationSource {target} is no animation: the skeleton is at rest",
            skeleton.GetPath(),
        )


def _read_influences(
    query: UsdSkel.SkinningQuery, skeleton: UsdSkel.SkeletonQuery, points: int, time: Usd.TimeCode
) -> Influences:
    """Joints and weights, checked against points and joints."""
    of_indices, of_weights = query.GetJointIndicesPrimvar(), query.GetJointWeightsPrimvar()
    if not of_indices or not of_weights:
        raise _BrokenSkinError(f"skel:{'jointWeights' if of_indices else 'jointIndices'} are missing")
    elements, interpolation = of_indices.GetElementSize(), of_indices.GetInterpolation()
    if (of_weights.GetElementSize(), of_weights.GetInterpolation()) != (elements, interpolation):
        raise _BrokenSkinError(
            "skel:jointIndices and skel:jointWeights differ in elementSize or interpolation"
        )
    if interpolation not in ("constant", "vertex"):
        raise _BrokenSkinError(f"joint influences have {interpolation} interpolation, not constant or vertex")
    rigid = interpolation == "constant"
    indices = np.ascontiguousarray(_flat(of_indices, time), np.int32)
    weights = np.ascontiguousarray(_flat(of_weights, time), np.float32)
    expected = max(elements, 0) * (1 if rigid else points)
    for name, found in (("jointIndices", indices), ("jointWeights", weights)):
        if found.size != expected or not expected:
            raise _BrokenSkinError(
                f"skel:{name} has {found.size} values, but {interpolation} interpolation with elementSize "
                f"{elements} asks for {expected}"
            )
    joints = len(query.GetJointOrder() or skeleton.GetJointOrder())
    bad = indices[(indices < 0) | (indices >= joints)]
    if bad.size:
        raise _BrokenSkinError(f"joint index {bad[0]} is out of range: there are {joints} joints")
    if not np.isfinite(weights).all():
        raise _BrokenSkinError("skel:jointWeights holds infinite or NaN values")
    return Influences(indices, weights, elements, rigid)


def _flat(primvar: UsdGeom.Primvar, time: Usd.TimeCode) -> npt.NDArray[Any]:
    value = primvar.ComputeFlattened(time)
    return np.asarray(value if value is not None else ()).ravel()


def _check_pose(
    skeleton: UsdSkel.SkeletonQuery, influences: Influences, query: UsdSkel.SkinningQuery, time: Usd.TimeCode
) -> None:
    """Bind transforms can be inverted, and joints have transforms."""
    path = skeleton.GetPrim().GetPath()
    joints = [str(j) for j in skeleton.GetJointOrder()]
    bind = np.array([to_matrix(m) for m in skeleton.GetJointWorldBindTransforms()])
    if not skeleton.HasBindPose() or len(bind) != len(joints):
        raise _BrokenSkinError(f"{path} has not one bindTransform for each of its {len(joints)} joints")
    order = query.GetJointOrder()
    used = np.unique(influences.indices[influences.weights != 0])
    if order:
        missing = [str(order[int(i)]) for i in used if str(order[int(i)]) not in joints]
        if missing:
            raise _BrokenSkinError(f"its joint {missing[0]} is none of {path}")
        used = np.array([joints.index(str(order[int(i)])) for i in used], np.int64)
    finite = np.isfinite(bind).all(axis=(1, 2))
    regular = finite & (np.abs(np.linalg.det(np.where(finite[:, None, None], bind, 0.0))) > 0)
    if not regular[used].all():
        bad = joints[used[~regular[used]][0]]
        raise _BrokenSkinError(f"the bindTransform of joint {bad} of {path} cannot be inverted")
    matrices = skeleton.ComputeSkinningTransforms(time)
    if matrices is None or len(matrices) != len(joints):
        raise _BrokenSkinError(
            f"{path} has neither an animation nor restTransforms for its {len(joints)} joints"
        )
    if not np.isfinite(np.array([to_matrix(matrices[int(i)]) for i in used])).all():
        raise _BrokenSkinError(f"the pose of {path} holds infinite or NaN values")
