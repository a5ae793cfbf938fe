"""UsdSkel: the pose of a skinned prim over the shutter, without a change to the stage.

Joint influences (linear blend and dual quaternions) and blend shapes are UsdSkel's own functions; here they
get checked arrays, the prim's times, and a way from the skeleton's space to that of the prim. Posed points
are in the space of the prim, as UsdSkel.BakeSkinning() writes them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from encore.adapters.blend_shapes import BlendShapes
from encore.adapters.context import Matrix, SyncContext, to_matrix
from encore.adapters.matrix_motion import local_transform
from encore.adapters.motion import resample, uniform
from encore.adapters.primvars import FloatArray, IntArray, Primvar

_IDENTITY: Matrix = np.eye(4)


@dataclass(frozen=True)
class Influences:
    """elements of indices and weights per point; rigid: the same for all points, one set of them."""

    indices: IntArray
    weights: FloatArray
    elements: int
    rigid: bool


@dataclass
class Skin:
    """How a prim is posed.

    to_prim: the skeleton's space to the prim's, by stage time. None where only blend shapes deform it: they
    are in the prim's own space.
    """

    prim: Usd.Prim
    skeleton: UsdSkel.SkeletonQuery
    query: UsdSkel.SkinningQuery
    shapes: BlendShapes | None
    influences: Influences | None
    to_prim: Relative

    @property
    def is_rigid(self) -> bool:
        """True where joints move it as a whole, and nothing else deforms it."""
        return self.shapes is None and self.influences is not None and self.influences.rigid

    def mirrors(self, time: Usd.TimeCode) -> bool:
        """True where joints carry it as a whole to its mirror image, so that its faces turn round."""
        rigid = self.influences is not None and self.influences.rigid
        return rigid and bool(np.linalg.det(self._carrying(time)[:3, :3]) < 0)

    def pose(
        self, points: FloatArray, context: SyncContext, attribute: Usd.Attribute | None = None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Posed points (n, 3) at the frame's time, and (keys, n, 3) over the shutter; None: they stay.

        points: at rest, at the frame's time. attribute: of points that may vary.
        """
        varies = attribute is not None and attribute.ValueMightBeTimeVarying()

        def rest(time: Usd.TimeCode) -> FloatArray:
            if not varies or time == context.time:
                return points
            found = np.asarray(attribute.Get(time), dtype=np.float32)  # type: ignore[union-attr]
            return found if found.shape == points.shape else points

        def posed(time: Usd.TimeCode) -> FloatArray:
            return self._posed_points(rest(time), time)

        extra = [attribute] if varies else []
        return posed(context.time), self._keys(posed, extra, context)

    def pose_normals(
        self, normals: Primvar, corners: IntArray, points: int, keys: int, context: SyncContext
    ) -> tuple[Primvar, FloatArray | None] | None:
        """Normals at the frame's time, and their values at `keys` uniform times over the shutter.

        corners: the point of every face corner. None where the prim is bent and its normals belong neither
        to its points nor to corners: they are to be left out.
        """
        flat, owners = normals.values, None
        if not self.is_rigid:
            # Corners with the same value, but of other points, part.
            flat = flat if normals.indices is None else flat[normals.indices]
            owners = corners if normals.interpolation == "faceVarying" else None
            if len(flat) != (points if owners is None else len(owners)):
                return None
            normals = normals._replace(indices=None)

        def posed(time: Usd.TimeCode) -> FloatArray:
            return self._posed_normals(flat, owners, time)

        motion = None
        if keys > 1 and context.shutter is not None:
            opens, closes = context.shutter
            times = [Usd.TimeCode(float(opens + f * (closes - opens))) for f in uniform(keys)]
            motion = np.stack([posed(t) for t in times])
        return normals._replace(values=posed(context.time)), motion

    def carry(self, data: Any, context: SyncContext) -> Any:
        """MeshData of a shape in the prim's own space, as a whole where joints carry it."""
        if self.influences is None:
            return data
        rest = data.points.astype(np.float64)
        matrix = self._carrying(context.time)

        def posed(time: Usd.TimeCode) -> FloatArray:
            own = self._carrying(time)
            return (rest @ own[:3, :3] + own[3, :3]).astype(np.float32)

        moved = data.transformed(matrix)
        moved.motion_points = self._keys(posed, (), context)
        if moved.motion_points is not None and moved.normals is not None:
            found = self.pose_normals(
                data.normals, data.face_vertex_indices, 0, len(moved.motion_points), context
            )
            assert found is not None, "what is carried as a whole keeps all its normals"
            moved.motion_normals = found[1]
        return moved

    def _carrying(self, time: Usd.TimeCode) -> Matrix:
        """In the prim's own space, where all of it follows the same joints."""
        return self._rigid_matrix(time) @ self.to_prim.at(time)

    # At one time

    def _posed_points(self, rest: FloatArray, time: Usd.TimeCode) -> FloatArray:
        points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rest))
        if self.shapes is not None:
            self.shapes.deform_points(points, time)
        if self.influences is None:
            return np.asarray(points)
        matrix = self._carrying(time) if self.influences.rigid else self.to_prim.at(time)
        if not self.influences.rigid:
            UsdSkel.SkinPoints(
                self.query.GetSkinningMethod(),
                self.query.GetGeomBindTransform(time),
                self._joint_matrices(time),
                Vt.IntArray.FromNumpy(self.influences.indices),
                Vt.FloatArray.FromNumpy(self.influences.weights),
                self.influences.elements,
                points,
                False,
            )
        if np.array_equal(matrix, _IDENTITY):
            return np.asarray(points)
        moved = np.asarray(points).astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]
        return moved.astype(np.float32)

    def _posed_normals(self, rest: FloatArray, owners: IntArray | None, time: Usd.TimeCode) -> FloatArray:
        """owners: the point of every normal; None: they are in the order of points, or all alike."""
        values = rest
        if self.shapes is not None:
            values = self.shapes.deform_normals(values, owners, time)
        if self.influences is None:
            return values
        matrix = self._carrying(time) if self.influences.rigid else self.to_prim.at(time)
        if not self.influences.rigid:
            values = self._skinned_normals(values, owners, time)
        if np.array_equal(matrix, _IDENTITY):
            return values
        turned = values.astype(np.float64) @ _cofactors(matrix[:3, :3])
        length = np.linalg.norm(turned, axis=-1, keepdims=True)
        return (turned / np.where(length > 0, length, 1.0)).astype(np.float32)

    def _skinned_normals(self, values: FloatArray, owners: IntArray | None, time: Usd.TimeCode) -> FloatArray:
        assert self.influences is not None
        elements = self.influences.elements
        indices = self.influences.indices.reshape(-1, elements)
        weights = self.influences.weights.reshape(-1, elements)
        if owners is not None:
            indices, weights = indices[owners], weights[owners]
        normals = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values))
        UsdSkel.SkinNormals(
            self.query.GetSkinningMethod(),
            _to_normals(self.query.GetGeomBindTransform(time)),
            Vt.Matrix3dArray([_to_normals(m) for m in self._joint_matrices(time)]),
            Vt.IntArray.FromNumpy(np.ascontiguousarray(indices.ravel())),
            Vt.FloatArray.FromNumpy(np.ascontiguousarray(weights.ravel())),
            elements,
            normals,
            False,
        )
        return np.asarray(normals)

    def _joint_matrices(self, time: Usd.TimeCode) -> Vt.Matrix4dArray:
        """What carries points from the bind pose, per joint of the prim."""
        found = self.skeleton.ComputeSkinningTransforms(time)
        mapper = self.query.GetJointMapper()
        if mapper is None or mapper.IsNull() or mapper.IsIdentity():
            return found
        return mapper.RemapTransforms(found, Vt.Matrix4dArray(len(self.query.GetJointOrder())))

    def _rigid_matrix(self, time: Usd.TimeCode) -> Matrix:
        """The prim's own space to the skeleton's, where all of it follows the same joints."""
        assert self.influences is not None
        return to_matrix(
            UsdSkel.SkinTransform(
                self.query.GetSkinningMethod(),
                self.query.GetGeomBindTransform(time),
                self._joint_matrices(time),
                Vt.IntArray.FromNumpy(self.influences.indices),
                Vt.FloatArray.FromNumpy(self.influences.weights),
            )
        )

    # Over time

    def _keys(
        self,
        posed: Callable[[Usd.TimeCode], FloatArray],
        extra: Collection[Usd.Attribute],
        context: SyncContext,
    ) -> FloatArray | None:
        if context.shutter is None or not (extra or self.varies()):
            return None
        opens, closes = context.shutter
        interval = Gf.Interval(opens, closes)
        times = {opens, closes, *self._times(interval)}
        times |= {t for attribute in extra for t in attribute.GetTimeSamplesInInterval(interval)}

        def sample(fractions: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
            return np.stack([posed(Usd.TimeCode(float(opens + f * (closes - opens)))) for f in fractions])

        keys = resample(sample, sorted((t - opens) / (closes - opens) for t in times), matrices=False)
        return None if keys is None else np.ascontiguousarray(keys, dtype=np.float32)

    def varies(self) -> bool:
        """Whether the pose may vary with time."""
        animation = self.skeleton.GetAnimQuery()
        joints = self.influences is not None and (
            self.to_prim.varies or (bool(animation) and animation.JointTransformsMightBeTimeVarying())
        )
        shapes = (
            self.shapes is not None and bool(animation) and animation.BlendShapeWeightsMightBeTimeVarying()
        )
        return joints or shapes or self._geom_bind_varies

    @property
    def _geom_bind_varies(self) -> bool:
        attribute = self.query.GetGeomBindTransformAttr()
        return bool(attribute) and attribute.ValueMightBeTimeVarying()

    def _times(self, interval: Gf.Interval) -> set[float]:
        """Stage times at which the pose may change its course."""
        times = self.to_prim.times(interval)
        if self._geom_bind_varies:
            times |= {*self.query.GetGeomBindTransformAttr().GetTimeSamplesInInterval(interval)}
        animation = self.skeleton.GetAnimQuery()
        if animation:
            times |= {*animation.GetJointTransformTimeSamplesInInterval(interval)}
            times |= {*animation.GetBlendShapeWeightTimeSamplesInInterval(interval)}
        return times


class Relative:
    """From one prim's space to another's, through what they do not have in common."""

    def __init__(self, source: Usd.Prim, target: Usd.Prim, time: Usd.TimeCode) -> None:
        down, up = _chain(source), _chain(target)
        while down and up and down[-1].GetPath() == up[-1].GetPath():
            down.pop()
            up.pop()
        self._moving = [x for x in (*down, *up) if x.TransformMightBeTimeVarying()]
        self.varies = bool(self._moving)
        self._down = [_local(x) for x in down]
        self._up = [_local(x) for x in up]
        self._constant = None if self.varies else self._compute(time)

    def at(self, time: Usd.TimeCode) -> Matrix:
        return self._compute(time) if self._constant is None else self._constant

    def times(self, interval: Gf.Interval) -> set[float]:
        return {t for x in self._moving for t in x.GetTimeSamplesInInterval(interval)}

    def _compute(self, time: Usd.TimeCode) -> Matrix:
        matrix, back = Gf.Matrix4d(1), Gf.Matrix4d(1)
        for local in self._down:
            matrix *= local(time)
        for local in self._up:
            back *= local(time)
        return to_matrix(matrix * back.GetInverse())


def _chain(prim: Usd.Prim) -> list[UsdGeom.Xformable]:
    """The prim and its ancestors that transform it, itself first."""
    found = []
    while prim and not prim.IsPseudoRoot():
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            found.append(xformable)
            if xformable.GetResetXformStack():
                break
        prim = prim.GetParent()
    return found


def _local(xformable: UsdGeom.Xformable) -> Callable[[Usd.TimeCode], Gf.Matrix4d]:
    turning = local_transform(xformable)
    return lambda t: xformable.GetLocalTransformation(t) if t.IsDefault() else turning(t.GetValue())


def _to_normals(matrix: Gf.Matrix4d) -> Gf.Matrix3d:
    """The inverse transpose; what turns the same way where there is none, as for joints of scale 0."""
    linear = np.array(matrix, dtype=np.float64)[:3, :3]
    size = float(np.abs(linear).max())
    if not abs(np.linalg.det(linear)) > 1e-12 * size**3:
        return Gf.Matrix3d(_cofactors(linear).tolist())
    return matrix.ExtractRotationMatrix().GetInverse().GetTranspose()


def _cofactors(linear: Matrix) -> Matrix:
    """The inverse transpose times the size of the determinant, which singular matrices have as well."""
    found = np.stack([np.cross(linear[(i + 1) % 3], linear[(i + 2) % 3]) for i in range(3)])
    return found if np.linalg.det(linear) >= 0 else -found


def pose_geometry(data: Any, prim: UsdGeom.PointBased, skin: Skin, context: SyncContext) -> None:
    """Poses MeshData.

    Its points are then those of the frame's time and over the shutter. What comes out infinite or NaN is
    reported, and left at rest.
    """
    corners, count = data.face_vertex_indices, len(data.points)
    if len(corners) and (corners.min() < 0 or corners.max() >= count):
        return  # core says what is wrong
    points, motion = skin.pose(data.points, context, prim.GetPointsAttr())
    if not np.isfinite(points).all() or (motion is not None and not np.isfinite(motion).all()):
        context.reports.error(
            "bad skinning", "is rendered at rest: its pose has infinite or NaN points", prim.GetPath()
        )
        return
    data.points, data.motion_points = points, motion
    data.left_handed = data.left_handed != skin.mirrors(context.time)
    if data.normals is None:
        return
    keys = 0 if motion is None else len(motion)
    posed = skin.pose_normals(data.normals, corners, count, keys, context)
    if posed is None:
        left = "those of its shape are used" if data.shape == "faces" else "they stay as they are"
        context.reports.add(
            "normals of a skinned prim",
            f"its {data.normals.interpolation} normals cannot be bent with it: {left}",
            prim.GetPath(),
        )
        if data.shape == "faces":
            data.normals = None
        return
    data.normals, data.motion_normals = posed
