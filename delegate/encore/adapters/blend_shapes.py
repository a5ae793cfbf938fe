"""Blend shapes of a skinned prim: offsets of points and normals, weighted by the skeleton's animation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdSkel, Vt

from encore.adapters.context import SyncContext
from encore.adapters.primvars import FloatArray, IntArray


@dataclass
class BlendShapes:
    """Shapes of one prim. Their sub-shapes are their rest, in-betweens, and the shapes themselves.

    usable: per shape; others are left out. points: of the prim.
    """

    query: UsdSkel.BlendShapeQuery
    mapper: UsdSkel.AnimMapper
    animation: UsdSkel.AnimQuery
    points: int
    usable: npt.NDArray[np.bool_]

    def deform_points(self, points: Vt.Vec3fArray, time: Usd.TimeCode) -> None:
        """Moves points in place."""
        weights = self._sub_shape_weights(time)
        if weights is not None:
            self.query.ComputeDeformedPoints(*weights, self._indices, self._offsets, points)

    def deform_normals(self, normals: FloatArray, owners: IntArray | None, time: Usd.TimeCode) -> FloatArray:
        """Normals (n, 3), of unit length again. owners: the point of each; None: in their order."""
        weights = self._sub_shape_weights(time)
        if weights is None or not any(len(n) for n in self._normal_offsets):
            return normals
        offsets = np.zeros((self.points, 3))
        for weight, shape, sub_shape in zip(*weights, strict=True):
            found = self._normal_offsets[sub_shape]
            if len(found):
                indices = np.asarray(self._indices[shape], dtype=np.int64)
                np.add.at(offsets, indices if indices.size else np.arange(self.points), weight * found)
        moved = normals + (offsets if owners is None else offsets[owners])
        length = np.linalg.norm(moved, axis=-1, keepdims=True)
        return (moved / np.where(length > 0, length, 1.0)).astype(np.float32)

    def _sub_shape_weights(
        self, time: Usd.TimeCode
    ) -> tuple[Vt.FloatArray, Vt.UIntArray, Vt.UIntArray] | None:
        """(weights, shapes, sub-shapes) of what is to be added; None where that is nothing."""
        weights = self.animation.ComputeBlendShapeWeights(time)
        if weights is None:
            return None
        if self.mapper is not None and not self.mapper.IsIdentity():
            weights = self.mapper.Remap(weights)
        if len(weights) != self.query.GetNumBlendShapes() or not np.isfinite(np.asarray(weights)).all():
            return None
        used = np.where(self.usable, np.asarray(weights, dtype=np.float32), np.float32(0))
        found = [np.asarray(v) for v in self.query.ComputeSubShapeWeights(Vt.FloatArray.FromNumpy(used))]
        # UsdSkel mistakes the sub-shapes of shapes that do not exist.
        kept = self.usable[found[1].astype(np.int64)]
        if not kept.any():
            return None
        weights, shapes, sub_shapes = (np.ascontiguousarray(v[kept]) for v in found)
        return (
            Vt.FloatArray.FromNumpy(weights),
            Vt.UIntArray.FromNumpy(shapes),
            Vt.UIntArray.FromNumpy(sub_shapes),
        )

    @cached_property
    def _indices(self) -> list[Vt.IntArray]:
        return list(self.query.ComputeBlendShapePointIndices())

    @cached_property
    def _offsets(self) -> list[Vt.Vec3fArray]:
        return list(self.query.ComputeSubShapePointOffsets())

    @cached_property
    def _normal_offsets(self) -> list[npt.NDArray[np.float64]]:
        """Per sub-shape (m, 3): of the points that its shape moves, or of all. None of the one at rest."""
        found = []
        for i, offsets in enumerate(self._offsets):
            shape, between = self.query.GetBlendShapeIndex(i), self.query.GetInbetween(i)
            value = None
            if between:
                value = between.GetNormalOffsets()
            elif len(offsets):
                value = self.query.GetBlendShape(shape).GetNormalOffsetsAttr().Get()
            normals = np.asarray(value if value is not None else (), dtype=np.float64).reshape(-1, 3)
            fits = len(normals) == (len(self._indices[shape]) or self.points)
            found.append(normals if fits else normals[:0])
        return found


def read_blend_shapes(
    query: UsdSkel.SkinningQuery, skeleton: UsdSkel.SkeletonQuery, points: int, context: SyncContext
) -> BlendShapes | None:
    """The shapes of a prim of `points` points; None without any, or without an animation that weighs them.

    Broken ones are reported and left out.
    """
    targets = query.GetBlendShapeTargetsRel().GetForwardedTargets() if query.GetBlendShapeTargetsRel() else []
    animation = skeleton.GetAnimQuery()
    if not targets or not animation:
        return None
    prim = query.GetPrim()
    names = query.GetBlendShapeOrder() or ()
    if len(names) != len(targets):
        context.reports.error(
            "bad blend shapes",
            f"skel:blendShapes has {len(names)} names, but there are {len(targets)} blendShapeTargets: they "
            "have no effect",
            prim.GetPath(),
        )
        return None
    usable = np.array([_is_usable(context.stage.GetPrimAtPath(t), t, prim, points, context) for t in targets])
    if not usable.any():
        return None
    shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
    return BlendShapes(shapes, query.GetBlendShapeMapper(), animation, points, usable)


def _is_usable(shape: Usd.Prim, target: Sdf.Path, prim: Usd.Prim, points: int, context: SyncContext) -> bool:
    """Whether a shape fits a prim of `points` points, which is reported where it does not."""
    exists = shape and shape.IsActive()
    what = _what_is_wrong(UsdSkel.BlendShape(shape), points) if exists else "does not exist"
    if what:
        context.reports.error(
            "bad blend shape", f"blend shape {target} has no effect: it {what}", prim.GetPath()
        )
    return not what


def _what_is_wrong(shape: UsdSkel.BlendShape, points: int) -> str:
    if not shape:
        return "is no BlendShape"
    value = shape.GetPointIndicesAttr().Get()
    indices = np.asarray(value if value is not None else (), dtype=np.int64)
    if indices.size and (indices.min() < 0 or indices.max() >= points):
        return f"has pointIndices that are out of range: there are {points} points"
    expected = indices.size or points
    offsets = [("offsets", shape.GetOffsetsAttr().Get())]
    offsets += [(b.GetAttr().GetName(), b.GetOffsets()) for b in shape.GetInbetweens()]
    for name, found in offsets:
        numbers = np.asarray(found if found is not None else (), dtype=np.float64)
        if len(numbers) not in (0, expected):
            return f"has {len(numbers)} {name} for {expected} points"
        if not np.isfinite(numbers).all():
            return f"has infinite or NaN {name}"
    return ""
