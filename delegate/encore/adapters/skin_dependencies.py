"""What the pose of a skinned prim depends on besides the prim: SkelRoot, skeleton, animation, shapes."""

from __future__ import annotations

import numpy as np
from pxr import Sdf, Usd, UsdSkel

INFLUENCES = "primvars:skel:jointIndices"
BLEND_SHAPES = "skel:blendShapeTargets"

# Of an ancestor, inherited by skinned prims below it.
_INHERITED = (
    "skel:joints",
    "primvars:skel:geomBindTransform",
    "primvars:skel:jointIndices",
    "primvars:skel:jointWeights",
    "primvars:skel:skinningMethod",
)


def outermost_root(prim: Usd.Prim) -> UsdSkel.Root | None:
    """The SkelRoot that poses a prim, itself or above it: skeletons of one nested in another are its own."""
    found = None
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdSkel.Root):
            found = UsdSkel.Root(prim)
        prim = prim.GetParent()
    return found


def inherited_target(prim: Usd.Prim, name: str) -> tuple[Sdf.Path | None, Usd.Prim | None]:
    """The target of a binding relationship on the prim or the nearest prim above, and that prim."""
    while prim and not prim.IsPseudoRoot():
        relationship = prim.GetRelationship(name) if prim.HasAPI(UsdSkel.BindingAPI) else None
        if relationship and relationship.HasAuthoredTargets():
            targets = relationship.GetForwardedTargets()
            return (targets[0] if targets else None), prim
        prim = prim.GetParent()
    return None, None


def binding_signature(instance: Usd.Prim, time: Usd.TimeCode) -> tuple[object, ...]:
    """Equal for native instances whose skinned contents have the same pose.

    By what they inherit at the instance: bindings to skeletons and animations, and influences.
    """
    path = instance.GetPath()
    signature: list[object] = [outermost_root(instance) is not None]
    for name in ("skel:skeleton", "skel:animationSource"):
        target, _ = inherited_target(instance, name)
        if target is not None and target.HasPrefix(path):
            signature.append(str(target.MakeRelativePath(path)))
        elif target is not None and name == "skel:skeleton":
            # Points are where the skeleton is, and so in another place of each instance's space.
            signature.append((str(target), str(path)))
        else:
            signature.append(str(target))
    for name in _INHERITED:
        attribute = _inherited_attribute(instance, name)
        if attribute is None:
            signature.append(None)
        elif attribute.ValueMightBeTimeVarying():
            signature.append(str(attribute.GetPath()))
        else:
            signature.append(str(np.array(attribute.Get(time)).tolist()))
    return tuple(signature)


def _inherited_attribute(prim: Usd.Prim, name: str) -> Usd.Attribute | None:
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            return attribute
        prim = prim.GetParent()
    return None


def binds_skeletons(prim: Usd.Prim) -> bool:
    """Whether a prim takes part in skinning by itself, as a root, a skeleton, or by a binding."""
    return prim.HasAPI(UsdSkel.BindingAPI) or prim.IsA(UsdSkel.Root) or prim.IsA(UsdSkel.Skeleton)


def skin_dependencies(prim: Usd.Prim) -> frozenset[Sdf.Path]:
    """Paths of the prims, besides itself, whose properties decide how a skinned prim is posed.

    All prims above it and above its skeleton (bindings and transforms are inherited), the animation of the
    skeleton, and blend shapes. Those that are bound but do not exist are among them.
    """
    found = set(prim.GetPath().GetPrefixes())
    stage = prim.GetStage()
    skeleton, _ = inherited_target(prim, "skel:skeleton")
    if skeleton is not None:
        found |= set(skeleton.GetPrefixes())
        bound = stage.GetPrimAtPath(skeleton)
        animation = inherited_target(bound, "skel:animationSource")[0] if bound else None
        if animation is not None:
            found.add(animation)
    relationship = prim.GetRelationship(BLEND_SHAPES)
    if relationship:
        found |= set(relationship.GetForwardedTargets())
    # What changes in an instance is told of by the paths of its prototype.
    for proxy in [p for p in map(stage.GetPrimAtPath, tuple(found)) if p and p.IsInstanceProxy()]:
        found.add(proxy.GetPrimInPrototype().GetPath())
    found.discard(prim.GetPath())
    return frozenset(found)
