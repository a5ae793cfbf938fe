"""UsdSkel: poses equal those that it bakes into a copy of the stage; dual quaternions equal a slow twin."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from encore.adapters.motion import interpolate
from encore.adapters.skin_dependencies import skin_dependencies
from encore.dump import dump
from encore.errors import StageError
from encore.render_index import RenderIndex, SyncOptions, Translation
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
from stages import add_instance, instances, kinds, meshes, translate

CHARACTER = "/World/Character"
SKELETON, ANIMATION, MESH = (f"{CHARACTER}/{name}" for name in ("Skeleton", "Animation", "Mesh"))
FRAMES = (1, 2, 3)
RINGS, SIDES = 9, 6
# Of rounding in single precision, for points within 10 of the origin.
CLOSE = {"rtol": 0, "atol": 4e-6}


def turn(degrees: float, axis: tuple[float, float, float] = (0, 1, 0)) -> Gf.Quatf:
    return Gf.Quatf(Gf.Rotation(Gf.Vec3d(*axis), degrees).GetQuat())


def shift(*by: float) -> Gf.Matrix4d:
    return Gf.Matrix4d().SetTranslate(by)


def tube() -> np.ndarray:
    """Rings of points round the y axis, from y = 0 to 3."""
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    rings = [[(0.3 * np.cos(a), y, 0.3 * np.sin(a)) for a in angles] for y in np.linspace(0, 3, RINGS)]
    return np.array(rings, np.float32).reshape(-1, 3)


def add_character(
    stage: Usd.Stage, path: str = CHARACTER, twist: float = 1.0, translate_by: tuple[float, ...] = (3, 1, 2)
) -> UsdSkel.Root:
    """A SkelRoot with a skeleton of three joints up the y axis, and an animation that bends and twists it."""
    root = UsdSkel.Root.Define(stage, path)
    root.AddTranslateOp().Set(tuple(translate_by))
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Skeleton")
    skeleton.AddRotateYOp().Set(30)
    skeleton.CreateJointsAttr(["A", "A/B", "A/B/C"])
    skeleton.CreateBindTransformsAttr([shift(0, 0, 0), shift(0, 1, 0), shift(0, 2, 0)])
    skeleton.CreateRestTransformsAttr([shift(0, 0, 0), shift(0, 1, 0), shift(0, 1, 0)])
    animation = UsdSkel.Animation.Define(stage, f"{path}/Animation")
    animation.CreateJointsAttr(["A/B", "A", "A/B/C"])  # in another order than the skeleton's
    animation.CreateTranslationsAttr([(0, 1, 0), (0, 0, 0), (0, 1, 0)])
    animation.CreateScalesAttr([(1, 1, 1)] * 3)
    rotations = animation.CreateRotationsAttr()
    for frame, angle in zip(FRAMES, (0, 40, 170), strict=True):
        turns = [turn(twist * angle), turn(twist * angle / 2, (1, 0, 0)), turn(twist * angle / 3, (0, 0, 1))]
        rotations.Set(Vt.QuatfArray(turns), frame)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return root


def add_tube(stage: Usd.Stage, path: str = MESH, skeleton: str = SKELETON, **more: Any) -> UsdGeom.Mesh:
    """A tube with normals, bound to a skeleton by influences of two joints per point."""
    points = tube()
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    ring, side = (a.ravel() for a in np.meshgrid(np.arange(RINGS - 1), np.arange(SIDES), indexing="ij"))
    beside = (side + 1) % SIDES
    quads = [
        ring * SIDES + side,
        ring * SIDES + beside,
        (ring + 1) * SIDES + beside,
        (ring + 1) * SIDES + side,
    ]
    mesh.CreateFaceVertexCountsAttr([4] * len(ring))
    mesh.CreateFaceVertexIndicesAttr(np.stack(quads, -1).ravel().tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateNormalsAttr((points * [1, 0, 1] / 0.3).tolist())
    bind(mesh.GetPrim(), skeleton, **more)
    return mesh


def influences(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints (n, 2) and weights (n, 2), by height."""
    y = points[:, 1]
    first = np.where(y < 1.5, 0, 1)
    weight = np.clip(y - 0.5 - first, 0, 1)
    return np.stack([first, first + 1], -1), np.stack([1 - weight, weight], -1)


def bind(prim: Usd.Prim, skeleton: str, method: str = "classicLinear") -> UsdSkel.BindingAPI:
    points = np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get())
    joints, weights = influences(points)
    api = UsdSkel.BindingAPI.Apply(prim)
    api.CreateSkeletonRel().SetTargets([skeleton])
    api.CreateJointIndicesPrimvar(False, 2).Set(joints.ravel().tolist())
    api.CreateJointWeightsPrimvar(False, 2).Set(weights.ravel().tolist())
    api.CreateSkinningMethodAttr(method)
    return api


def bind_rigidly(
    prim: Usd.Prim, skeleton: str, joints: list[int], weights: list[float]
) -> UsdSkel.BindingAPI:
    api = UsdSkel.BindingAPI.Apply(prim)
    api.CreateSkeletonRel().SetTargets([skeleton])
    api.CreateJointIndicesPrimvar(True, len(joints)).Set(joints)
    api.CreateJointWeightsPrimvar(True, len(joints)).Set(weights)
    return api


def baked(stage: Usd.Stage) -> Usd.Stage:
    """A copy of the stage in which UsdSkel has written all poses at the samples of animations."""
    copy = Usd.Stage.Open(stage.Flatten())
    for prim in copy.Traverse():
        if prim.IsA(UsdSkel.Root):
            assert UsdSkel.BakeSkinning(UsdSkel.Root(prim))
    return copy


def world(translation: Translation, path: str) -> np.ndarray:
    """World-space points of what is placed at a path."""
    scene, placed = translation.scene, instances(translation)[path]
    matrix = placed["to_world"]
    found = [scene.mesh(m)["points"] for m in scene.prototype(placed["prototype"])["meshes"]]
    return np.concatenate(found).astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]


def world_normals(translation: Translation, path: str) -> np.ndarray:
    """World-space normals, of unit length, of the one mesh at a path, per element."""
    scene, placed = translation.scene, instances(translation)[path]
    (index,) = scene.prototype(placed["prototype"])["meshes"]
    normals = scene.mesh(index)["normals"]
    values = normals["values"][normals["indices"]] if normals["indices"].size else normals["values"]
    turned = values.astype(np.float64) @ np.linalg.inv(placed["to_world"][:3, :3]).T
    return turned / np.linalg.norm(turned, axis=-1, keepdims=True)


def assert_as_baked(stage: Usd.Stage, *paths: str, frames: tuple[float, ...] = FRAMES) -> None:
    """At every frame, the translation of the stage shows what that of the baked copy shows, and moves."""
    copy = baked(stage)
    rest = translate(stage, time=Usd.TimeCode(frames[0]))
    for frame in frames:
        found = translate(stage, time=Usd.TimeCode(frame))
        expected = translate(copy, time=Usd.TimeCode(frame))
        assert not found.reports.has_errors, found.reports.lines()
        for path in paths:
            np.testing.assert_allclose(world(found, path), world(expected, path), **CLOSE)
            if meshes(expected).get(path, {}).get("normals"):
                np.testing.assert_allclose(
                    world_normals(found, path), world_normals(expected, path), rtol=0, atol=2e-5
                )
    for path in paths:
        assert np.abs(world(found, path) - world(rest, path)).max() > 0.1, "the last frame is another pose"


# Against UsdSkel's own baking


@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
def test_a_bent_mesh(stage: Usd.Stage, method: str) -> None:
    add_character(stage)
    add_tube(stage, method=method).AddTranslateOp().Set((0.1, 0.2, 0.3))
    assert_as_baked(stage, MESH)


def test_dual_quaternions_differ_from_linear_blending(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    linear = world(translate(stage, time=Usd.TimeCode(3)), MESH)
    UsdSkel.BindingAPI(mesh.GetPrim()).GetSkinningMethodAttr().Set("dualQuaternion")
    dual = world(translate(stage, time=Usd.TimeCode(3)), MESH)
    assert np.abs(linear - dual).max() > 0.05


@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
def test_normals_of_corners(stage: Usd.Stage, method: str) -> None:
    add_character(stage)
    mesh = add_tube(stage, method=method)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    mesh.GetNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(np.array(mesh.GetNormalsAttr().Get())[corners]))
    mesh.SetNormalsInterpolation("faceVarying")
    assert_as_baked(stage, MESH)


def test_indexed_normals_part_where_their_points_do(stage: Usd.Stage) -> None:
    """Values that corners of all rings share become one value per corner."""
    add_character(stage)
    mesh = add_tube(stage)
    values = np.array(mesh.GetNormalsAttr().Get())[:SIDES]
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    expected = translate(stage, time=Usd.TimeCode(3))
    mesh.GetNormalsAttr().Clear()
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "normals", Sdf.ValueTypeNames.Normal3fArray, UsdGeom.Tokens.faceVarying
    )
    primvar.Set(Vt.Vec3fArray.FromNumpy(values))
    primvar.SetIndices(Vt.IntArray.FromNumpy((corners % SIDES).astype(np.int32)))
    found = translate(stage, time=Usd.TimeCode(3))
    np.testing.assert_allclose(
        world_normals(found, MESH), world_normals(expected, MESH)[corners], rtol=0, atol=1e-5
    )


def test_uniform_normals_of_a_bent_mesh_are_left_out(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    mesh.GetNormalsAttr().Set([(1, 0, 0)] * len(mesh.GetFaceVertexCountsAttr().Get()))
    mesh.SetNormalsInterpolation("uniform")
    found = translate(stage, time=Usd.TimeCode(2))
    assert meshes(found)[MESH]["normals"] is None
    assert kinds(found)["normals of a skinned prim"] == 1


def test_a_bind_transform_of_the_geometry(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    matrix = Gf.Matrix4d().SetRotate(Gf.Rotation((0, 0, 1), 10)) * Gf.Matrix4d().SetScale((1, 1.2, 0.9))
    UsdSkel.BindingAPI(mesh).CreateGeomBindTransformAttr(matrix * shift(0, 0.1, 0))
    assert_as_baked(stage, MESH)


def test_a_subset_of_joints_in_its_own_order(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    api = UsdSkel.BindingAPI(mesh)
    api.CreateJointsAttr(["A/B/C", "A/B"])
    api.GetJointIndicesAttr().Set([1, 0] * (RINGS * SIDES))
    assert_as_baked(stage, MESH)


def test_the_binding_is_inherited(stage: Usd.Stage) -> None:
    root = add_character(stage)
    UsdGeom.Scope.Define(stage, f"{CHARACTER}/Geometry")
    mesh = add_tube(stage, f"{CHARACTER}/Geometry/Mesh")
    UsdSkel.BindingAPI(mesh).GetSkeletonRel().ClearTargets(True)
    UsdSkel.BindingAPI.Apply(root.GetPrim()).CreateSkeletonRel().SetTargets([SKELETON])
    skeleton = UsdSkel.BindingAPI(stage.GetPrimAtPath(SKELETON))
    skeleton.GetAnimationSourceRel().ClearTargets(True)
    UsdSkel.BindingAPI(root.GetPrim()).CreateAnimationSourceRel().SetTargets([ANIMATION])
    assert_as_baked(stage, f"{CHARACTER}/Geometry/Mesh")


def test_skeleton_and_mesh_that_move_on_their_own(stage: Usd.Stage) -> None:
    add_character(stage)
    op = UsdSkel.Skeleton.Get(stage, SKELETON).AddTranslateOp()
    for frame in FRAMES:
        op.Set((frame, 0, 0), frame)
    op = add_tube(stage).AddRotateXOp()
    for frame in FRAMES:
        op.Set(20.0 * frame, frame)
    assert_as_baked(stage, MESH)


def test_points_that_have_samples_of_their_own(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    for frame in FRAMES:
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(tube() * np.float32(1 + 0.1 * frame)), frame)
    found = [world(translate(stage, time=Usd.TimeCode(f)), MESH) for f in FRAMES]
    for frame, points in zip(FRAMES, found, strict=True):
        mesh.GetPointsAttr().Clear()
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(tube() * np.float32(1 + 0.1 * frame)))
        np.testing.assert_allclose(
            world(translate(baked(stage), time=Usd.TimeCode(frame)), MESH), points, **CLOSE
        )


def test_without_an_animation_the_rest_pose(stage: Usd.Stage) -> None:
    add_character(stage)
    add_tube(stage)
    UsdSkel.BindingAPI(stage.GetPrimAtPath(SKELETON)).GetAnimationSourceRel().ClearTargets(True)
    rests = [shift(0, 0, 0), shift(0.5, 1, 0), shift(0, 1, 0)]
    UsdSkel.Skeleton.Get(stage, SKELETON).GetRestTransformsAttr().Set(rests)
    found = world(translate(stage, time=Usd.TimeCode(2)), MESH)
    np.testing.assert_allclose(found, world(translate(baked(stage), time=Usd.TimeCode(2)), MESH), **CLOSE)
    assert found[-1, 0] != world(translate(stage, time=Usd.TimeCode(2)), MESH)[0, 0]


@pytest.mark.parametrize(("joints", "weights"), [([1], [1.0]), ([1, 2], [0.25, 0.75])])
def test_a_rigid_mesh(stage: Usd.Stage, joints: list[int], weights: list[float]) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    mesh.AddTranslateOp().Set((0.1, 0.2, 0.3))
    bind_rigidly(mesh.GetPrim(), SKELETON, joints, weights)
    assert_as_baked(stage, MESH)


def test_a_rigid_sphere(stage: Usd.Stage) -> None:
    add_character(stage)
    path = f"{CHARACTER}/Ball"
    ball = UsdGeom.Sphere.Define(stage, path)
    ball.CreateRadiusAttr(0.5)
    ball.AddTranslateOp().Set((0, 2, 0))
    other = UsdGeom.Sphere.Define(stage, f"{CHARACTER}/Still")
    other.CreateRadiusAttr(0.5)
    bind_rigidly(ball.GetPrim(), SKELETON, [2], [1.0])
    UsdSkel.BindingAPI(ball).CreateGeomBindTransformAttr(shift(0, 2, 0))
    assert_as_baked(stage, path)


def test_influences_of_a_parent_are_inherited(stage: Usd.Stage) -> None:
    add_character(stage)
    UsdGeom.Xform.Define(stage, f"{CHARACTER}/Arm")
    bind_rigidly(stage.GetPrimAtPath(f"{CHARACTER}/Arm"), SKELETON, [2], [1.0])
    UsdGeom.Cube.Define(stage, f"{CHARACTER}/Arm/Cube")
    assert_as_baked(stage, f"{CHARACTER}/Arm/Cube")


def test_curves_that_are_ribbons(stage: Usd.Stage) -> None:
    """UsdSkel bakes the points of all PointBased prims."""
    add_character(stage)
    path = f"{CHARACTER}/Hair"
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreatePointsAttr([(x, y, 0) for x in (0, 0.1) for y in np.linspace(0, 3, 8)])
    curves.CreateCurveVertexCountsAttr([8, 8])
    curves.CreateTypeAttr("linear")
    curves.CreateNormalsAttr([(0, 0, 1)] * 16)
    bind(curves.GetPrim(), SKELETON)
    assert_as_baked(stage, path)


def test_spheres_at_points(stage: Usd.Stage) -> None:
    add_character(stage)
    path = f"{CHARACTER}/Dust"
    points = UsdGeom.Points.Define(stage, path)
    points.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(tube()))
    points.CreateWidthsAttr([0.1] * len(tube()))
    bind(points.GetPrim(), SKELETON)
    assert_as_baked(stage, path)


def set_scales(stage: Usd.Stage, scale: tuple[float, float, float]) -> None:
    """Of the last joint, at all times."""
    UsdSkel.Animation.Get(stage, ANIMATION).GetScalesAttr().Set([(1, 1, 1), (1, 1, 1), scale])


def test_a_rigid_mesh_that_is_mirrored(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    bind_rigidly(mesh.GetPrim(), SKELETON, [2], [1.0])
    set_scales(stage, (-1, 1, 1))
    assert_as_baked(stage, MESH)
    found = translate(stage, time=Usd.TimeCode(2))
    matrix = instances(translate(baked(stage), time=Usd.TimeCode(2)))[MESH]["to_world"]
    assert np.linalg.det(matrix[:3, :3]) < 0 and np.linalg.det(instances(found)[MESH]["to_world"][:3, :3]) > 0
    assert meshes(found)[MESH]["left_handed"], "its faces still look outwards"


@pytest.mark.parametrize("rigid", [False, True])
def test_a_joint_of_scale_0_hides_what_it_moves(stage: Usd.Stage, rigid: bool) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    if rigid:
        bind_rigidly(mesh.GetPrim(), SKELETON, [2], [1.0])
    set_scales(stage, (0, 0, 0))
    translation = translate(stage, time=Usd.TimeCode(2), strict=True)
    translation.scene.validate()
    found = meshes(translation)[MESH]
    assert np.isfinite(found["normals"]["values"]).all()
    assert np.ptp(found["points"][-SIDES:], axis=0).max() < 1e-6
    if not rigid:
        np.testing.assert_allclose(np.linalg.norm(found["normals"]["values"][:SIDES], axis=-1), 1, atol=1e-5)


# Blend shapes


def add_shape(mesh: UsdGeom.Mesh, name: str, offsets: Any, indices: Any = ()) -> UsdSkel.BlendShape:
    """A shape on the mesh: offsets of points, with normals that they turn as well."""
    stage, path = mesh.GetPrim().GetStage(), mesh.GetPath().AppendChild(name)
    shape = UsdSkel.BlendShape.Define(stage, path)
    shape.CreateOffsetsAttr(offsets)
    shape.CreateNormalOffsetsAttr(offsets)
    if len(indices):
        shape.CreatePointIndicesAttr(indices)
    api = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    targets = [*api.CreateBlendShapeTargetsRel().GetTargets(), path]
    api.GetBlendShapeTargetsRel().SetTargets(targets)
    api.CreateBlendShapesAttr([t.name for t in targets])
    return shape


def weigh(stage: Usd.Stage, names: list[str], *weights: list[float]) -> None:
    animation = UsdSkel.Animation.Get(stage, ANIMATION)
    animation.CreateBlendShapesAttr(names)
    for frame, values in zip(FRAMES, weights, strict=True):
        animation.CreateBlendShapeWeightsAttr().Set(values, frame)


def add_shapes(stage: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
    """Two: all points with an in-between that goes another way, and a few points."""
    points = np.array(mesh.GetPointsAttr().Get())
    smile = add_shape(mesh, "smile", (points * [1, 0, 1]).tolist())
    half = smile.CreateInbetween("half")
    half.SetWeight(0.5)
    half.SetOffsets([(0, 0.4, 0.1)] * len(points))
    half.CreateNormalOffsetsAttr([(0, 0.2, 0)] * len(points))
    add_shape(mesh, "wink", [(0.3, 0.2, 0)] * 3, [1, 2, 5])
    weigh(stage, ["wink", "unused", "smile"], [0.0, 9.0, 0.0], [0.5, 9.0, 0.3], [1.5, 9.0, 0.8])


@pytest.mark.parametrize("bound", [True, False], ids=["with joints", "without joints"])
def test_blend_shapes(stage: Usd.Stage, bound: bool) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    if not bound:
        for name in ("skel:jointIndices", "skel:jointWeights"):
            UsdGeom.PrimvarsAPI(mesh).RemovePrimvar(name)
    add_shapes(stage, mesh)
    assert_as_baked(stage, MESH)


def test_blend_shapes_by_hand(stage: Usd.Stage) -> None:
    """A quarter is half way to the in-between; three quarters are half way from there to the shape."""
    add_character(stage, twist=0.0, translate_by=(0, 0, 0))
    mesh = add_tube(stage)
    for name in ("skel:jointIndices", "skel:jointWeights"):
        UsdGeom.PrimvarsAPI(mesh).RemovePrimvar(name)
    shape = add_shape(mesh, "s", [(1, 0, 0)] * len(tube()))
    half = shape.CreateInbetween("half")
    half.SetWeight(0.5)
    half.SetOffsets([(0, 1, 0)] * len(tube()))
    weigh(stage, ["s"], [0.25], [0.75], [1.0])
    for frame, offset in zip(FRAMES, [(0, 0.5, 0), (0.5, 0.5, 0), (1, 0, 0)], strict=True):
        found = world(translate(stage, time=Usd.TimeCode(frame)), MESH)
        np.testing.assert_allclose(found, tube() + np.array(offset), **CLOSE)


# Dual quaternions, against an obvious twin


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of quaternions (w, x, y, z)."""
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.array([w, *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def dual_quaternion(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of a rigid matrix of row vectors: rotation, and half of translation times rotation."""
    quaternion = Gf.Matrix4d(matrix.tolist()).ExtractRotationQuat()
    real = np.array([quaternion.GetReal(), *quaternion.GetImaginary()])
    return real, 0.5 * product(np.array([0, *matrix[3, :3]]), real)


def skin_by_dual_quaternions(
    points: np.ndarray, joints: np.ndarray, weights: np.ndarray, matrices: np.ndarray
) -> np.ndarray:
    """Kavan et al. 2007: blend, normalise, apply. Signs as the first joint's."""
    parts = [dual_quaternion(m) for m in matrices]
    found = []
    for point, own, own_weights in zip(points, joints, weights, strict=True):
        real, dual = np.zeros(4), np.zeros(4)
        pivot = parts[own[np.argmax(own_weights)]][0]
        for joint, weight in zip(own, own_weights, strict=True):
            sign = 1.0 if parts[joint][0] @ pivot >= 0 else -1.0
            real, dual = real + sign * weight * parts[joint][0], dual + sign * weight * parts[joint][1]
        real, dual = real / np.linalg.norm(real), dual / np.linalg.norm(real)
        inverse = real * [1, -1, -1, -1]
        moved = product(product(real, np.array([0, *point])), inverse)[1:]
        found.append(moved + 2 * product(dual, inverse)[1:])
    return np.array(found)


def test_dual_quaternions_are_those_of_the_paper(stage: Usd.Stage) -> None:
    add_character(stage, translate_by=(0, 0, 0))
    UsdSkel.Skeleton.Get(stage, SKELETON).ClearXformOpOrder()
    add_tube(stage, method="dualQuaternion")
    points = tube()
    joints, weights = influences(points)
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, CHARACTER), Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, SKELETON))
    for frame in (*FRAMES, 1.5, 2.75):
        matrices = np.array(query.ComputeSkinningTransforms(frame))
        expected = skin_by_dual_quaternions(points, joints, weights, matrices)
        found = world(translate(stage, time=Usd.TimeCode(frame)), MESH)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


def test_dual_quaternions_keep_a_twisted_tube_round(stage: Usd.Stage) -> None:
    """Twisted by half a turn, linear blending closes the tube between joints; dual quaternions do not."""
    add_character(stage, translate_by=(0, 0, 0), twist=0.0)
    turns = [turn(180), turn(0), turn(0)]
    UsdSkel.Animation.Get(stage, ANIMATION).GetRotationsAttr().Set(Vt.QuatfArray(turns), 2)
    mesh = add_tube(stage, method="dualQuaternion")

    def radii() -> np.ndarray:
        points = meshes(translate(stage, time=Usd.TimeCode(2)))[MESH]["points"]
        skeleton = np.array(UsdGeom.Xformable.Get(stage, SKELETON).GetLocalTransformation())
        points = points @ np.linalg.inv(skeleton)[:3, :3]
        return np.linalg.norm(points[:, [0, 2]], axis=-1)

    np.testing.assert_allclose(radii(), 0.3, rtol=1e-5)
    UsdSkel.BindingAPI(mesh).GetSkinningMethodAttr().Set("classicLinear")
    assert radii().min() < 0.1


# Motion


@pytest.fixture
def shutter(stage: Usd.Stage) -> tuple[float, float]:
    """Opens half a frame before, closes half a frame after."""
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateShutterOpenAttr(-0.5)
    camera.CreateShutterCloseAttr(0.5)
    return -0.5, 0.5


def assert_follows(stage: Usd.Stage, path: str, time: float, shutter: tuple[float, float]) -> np.ndarray:
    """Keys that, interpolated, are what still frames show; the keys."""
    keys = np.array(meshes(translate(stage, time=Usd.TimeCode(time)))[path]["motion_points"])
    opens, closes = shutter
    fractions = np.linspace(0, 1, 23)
    stage.GetPrimAtPath("/World/Camera").SetActive(False)
    truth = [
        meshes(translate(stage, time=Usd.TimeCode(time + opens + f * (closes - opens))))[path]["points"]
        for f in fractions
    ]
    stage.GetPrimAtPath("/World/Camera").SetActive(True)
    distance = np.linalg.norm(np.array(truth) - truth[0], axis=-1).max()
    assert distance > 0.05
    np.testing.assert_allclose(interpolate(keys, fractions), truth, rtol=0, atol=2e-3 * distance)
    return keys


@pytest.mark.parametrize("time", [1.7, 2, 2.5])
def test_motion_follows_the_joints(stage: Usd.Stage, shutter: tuple[float, float], time: float) -> None:
    add_character(stage)
    add_tube(stage)
    keys = assert_follows(stage, MESH, time, shutter)
    assert len(keys) > 2, "what turns needs more than two"
    found = meshes(translate(stage, time=Usd.TimeCode(time)))[MESH]
    normals = np.array(found["motion_normals"])
    assert normals.shape == keys.shape
    assert np.abs(normals - found["normals"]["values"]).max() > 0.05


def test_motion_of_blend_shapes_has_their_corners(stage: Usd.Stage, shutter: tuple[float, float]) -> None:
    add_character(stage, twist=0.0)
    mesh = add_tube(stage)
    add_shapes(stage, mesh)
    assert_follows(stage, MESH, 2, shutter)


def test_motion_of_what_is_rigid(stage: Usd.Stage, shutter: tuple[float, float]) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    bind_rigidly(mesh.GetPrim(), SKELETON, [1, 2], [0.5, 0.5])
    assert_follows(stage, MESH, 2, shutter)
    ball = UsdGeom.Sphere.Define(stage, f"{CHARACTER}/Ball")
    bind_rigidly(ball.GetPrim(), SKELETON, [2], [1.0])
    keys = assert_follows(stage, f"{CHARACTER}/Ball", 2, shutter)
    found = meshes(translate(stage, time=Usd.TimeCode(2)))[f"{CHARACTER}/Ball"]
    normals = np.array(found["motion_normals"])
    assert normals.shape == (len(keys), *found["normals"]["values"].shape)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-5)


def test_a_pose_that_is_held_does_not_move(stage: Usd.Stage, shutter: tuple[float, float]) -> None:
    add_character(stage)
    add_tube(stage)
    assert len(meshes(translate(stage, time=Usd.TimeCode(10)))[MESH]["motion_points"]) == 0
    assert len(meshes(translate(stage))[MESH]["motion_points"]) == 0


# Instances


def add_crowd(stage: Usd.Stage, *animations: str) -> None:
    """Instances of one character, which is authored in /Asset, with their animations."""
    add_character(stage, "/Asset", translate_by=(0, 0, 0))
    add_tube(stage, "/Asset/Mesh", "/Asset/Skeleton")
    UsdSkel.BindingAPI(stage.GetPrimAtPath("/Asset/Skeleton")).GetAnimationSourceRel().ClearTargets(True)
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for i, animation in enumerate(animations):
        prim = stage.DefinePrim(f"/World/Actor{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
        UsdGeom.XformCommonAPI(prim).SetTranslate((5.0 * i, 0, 0))
        if animation:
            relationship = UsdSkel.BindingAPI.Apply(prim).CreateAnimationSourceRel()
            relationship.SetTargets([animation.format(f"/World/Actor{i}")])


def test_instances_with_the_same_animation_share_a_prototype(stage: Usd.Stage) -> None:
    add_crowd(stage, "{}/Animation", "{}/Animation", "{}/Animation")
    translation = translate(stage, time=Usd.TimeCode(3))
    assert (translation.counts["meshes"], translation.counts["instances"]) == (1, 3)
    first, second = (world(translation, f"/World/Actor{i}") for i in range(2))
    np.testing.assert_allclose(first + np.array([5, 0, 0]), second, **CLOSE)


def test_instances_with_animations_of_their_own(stage: Usd.Stage) -> None:
    stage.DefinePrim("/Animations")
    for name, twist in (("Calm", 0.2), ("Wild", 1.0)):
        add_character(stage, f"/Animations/{name}", twist)
    add_crowd(
        stage, "/Animations/Calm/Animation", "/Animations/Wild/Animation", "", "/Animations/Wild/Animation"
    )
    translation = translate(stage, time=Usd.TimeCode(3))
    assert (translation.counts["meshes"], translation.counts["instances"]) == (3, 4)
    for i in range(4):
        stage.GetPrimAtPath(f"/World/Actor{i}").SetInstanceable(False)
    alone = translate(stage, time=Usd.TimeCode(3))
    for i in range(4):
        np.testing.assert_allclose(
            world(translation, f"/World/Actor{i}"), world(alone, f"/World/Actor{i}/Mesh"), **CLOSE
        )


def test_instances_within_a_character_are_where_its_skeleton_is(stage: Usd.Stage) -> None:
    """A skeleton outside of instances poses each of them in its own space."""
    add_character(stage)
    part = add_tube(stage, "/Part/Mesh")
    UsdSkel.BindingAPI(part).GetSkeletonRel().ClearTargets(True)
    stage.GetPrimAtPath("/Part").SetSpecifier(Sdf.SpecifierClass)
    api = UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath(CHARACTER))
    api.CreateSkeletonRel().SetTargets([SKELETON])
    for i in range(2):
        prim = add_instance(stage, f"{CHARACTER}/Part{i}", "/Part")
        UsdGeom.XformCommonAPI(prim).SetTranslate((5.0 * i, 0, 0))
    found = translate(stage, time=Usd.TimeCode(3))
    np.testing.assert_allclose(
        world(found, f"{CHARACTER}/Part0"), world(found, f"{CHARACTER}/Part1"), **CLOSE
    )


def test_a_character_that_a_point_instancer_places(stage: Usd.Stage) -> None:
    add_character(stage, translate_by=(0, 0, 0))
    add_tube(stage)
    alone = world(translate(stage, time=Usd.TimeCode(3)), MESH)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Crowd")
    instancer.CreatePrototypesRel().SetTargets([CHARACTER])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(10, 0, 0), (20, 0, 0)])
    translation = translate(stage, time=Usd.TimeCode(3))
    found = instances(translation)
    places = [p for p in found if p.startswith("/World/Crowd")]
    assert len(places) == 2
    for i, path in enumerate(sorted(places)):
        np.testing.assert_allclose(
            world(translation, path), alone + np.array([10.0 * (i + 1), 0, 0]), **CLOSE
        )


def test_joints_that_should_carry_an_instancer_are_told_of(stage: Usd.Stage) -> None:
    add_character(stage)
    path = f"{CHARACTER}/Leaves"
    UsdGeom.Cube.Define(stage, f"{path}/Leaf")
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    instancer.CreatePrototypesRel().SetTargets([f"{path}/Leaf"])
    instancer.CreateProtoIndicesAttr([0])
    instancer.CreatePositionsAttr([(1, 0, 0)])
    bind_rigidly(instancer.GetPrim(), SKELETON, [2], [1.0])
    translation = translate(stage, time=Usd.TimeCode(2))
    assert kinds(translation)["skinned instancer"] == 1
    assert len(instances(translation)) == 1


# What depends on what


def test_dependencies(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    add_shapes(stage, mesh)
    expected = {"/World", CHARACTER, SKELETON, ANIMATION, f"{MESH}/smile", f"{MESH}/wink"}
    assert {str(p) for p in skin_dependencies(mesh.GetPrim())} == expected


EDITS: dict[str, Callable[[Usd.Stage], object]] = {
    "animation": lambda s: UsdSkel.Animation.Get(s, ANIMATION).GetTranslationsAttr().Set([(0, 2, 0)] * 3),
    "weights": lambda s: UsdSkel.Animation.Get(s, ANIMATION).GetBlendShapeWeightsAttr().Set([1, 1, 1], 2),
    "rest": lambda s: UsdSkel.BindingAPI.Get(s, SKELETON).GetAnimationSourceRel().SetTargets([]),
    "bind pose": lambda s: set_bind(s, [shift(0, 0, 0), shift(0, 1.5, 0), shift(0, 2, 0)]),
    "skeleton's place": lambda s: UsdSkel.Skeleton.Get(s, SKELETON).AddTranslateOp().Set((1, 2, 3)),
    "shape": lambda s: UsdSkel.BlendShape.Get(s, f"{MESH}/wink").GetOffsetsAttr().Set([(1, 1, 1)] * 3),
    "influences": lambda s: UsdSkel.BindingAPI.Get(s, MESH).GetJointIndicesAttr().Set([2, 0] * 54),
    "method": lambda s: UsdSkel.BindingAPI.Get(s, MESH).GetSkinningMethodAttr().Set("dualQuaternion"),
    "points": lambda s: UsdGeom.Mesh.Get(s, MESH).GetPointsAttr().Set((tube() * 2).tolist()),
    "no skeleton": lambda s: s.GetPrimAtPath(SKELETON).SetActive(False),
    "root": lambda s: s.GetPrimAtPath(CHARACTER).SetTypeName("Xform"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_after_edits_the_pose_is_that_of_a_fresh_translation(stage: Usd.Stage, edit: str) -> None:
    add_character(stage)
    add_shapes(stage, add_tube(stage))
    index = RenderIndex(stage, SyncOptions(time=Usd.TimeCode(2), camera_light=False))
    before = dump(index.sync())
    EDITS[edit](stage)
    after = dump(index.sync())
    assert after == dump(translate(stage, time=Usd.TimeCode(2)))
    assert after != before


def test_instances_follow_edits_of_their_animations(stage: Usd.Stage) -> None:
    stage.DefinePrim("/Animations")
    for name, twist in (("Calm", 0.2), ("Wild", 1.0)):
        add_character(stage, f"/Animations/{name}", twist)
    add_crowd(stage, "/Animations/Calm/Animation", "/Animations/Wild/Animation")
    index = RenderIndex(stage, SyncOptions(time=Usd.TimeCode(2), camera_light=False))
    before = dump(index.sync())
    calm = UsdSkel.Animation.Get(stage, "/Animations/Calm/Animation")
    calm.GetTranslationsAttr().Set([(0, 2, 0)] * 3)
    edited = dump(index.sync())
    assert edited == dump(translate(stage, time=Usd.TimeCode(2))) != before
    source = UsdSkel.BindingAPI.Get(stage, "/World/Actor0").GetAnimationSourceRel()
    source.SetTargets(["/Animations/Wild/Animation"])
    again = dump(index.sync())
    assert again == dump(translate(stage, time=Usd.TimeCode(2))) != edited


def test_at_other_times_the_pose_is_another(stage: Usd.Stage) -> None:
    add_character(stage)
    add_tube(stage)
    index = RenderIndex(stage, SyncOptions(camera_light=False))
    for frame in (1, 3, 2, 3):
        assert dump(index.sync(Usd.TimeCode(frame))) == dump(translate(stage, time=Usd.TimeCode(frame)))


def test_what_is_not_skinned_asks_for_nothing(stage: Usd.Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    add_character(stage)
    mesh = UsdGeom.Mesh.Define(stage, MESH)
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    monkeypatch.setattr(UsdSkel.Cache, "Populate", None)
    translation = translate(stage, time=Usd.TimeCode(2))
    np.testing.assert_array_equal(meshes(translation)[MESH]["points"], mesh.GetPointsAttr().Get())


# What is broken


def rest(stage: Usd.Stage, path: str = MESH) -> np.ndarray:
    return np.array(UsdGeom.Mesh.Get(stage, path).GetPointsAttr().Get())


Break = Callable[[Usd.Stage, UsdSkel.BindingAPI], object]


def set_bind(stage: Usd.Stage, matrices: list[Gf.Matrix4d]) -> None:
    UsdSkel.Skeleton.Get(stage, SKELETON).GetBindTransformsAttr().Set(matrices)


def set_joints(stage: Usd.Stage, joints: list[str]) -> None:
    UsdSkel.Skeleton.Get(stage, SKELETON).GetJointsAttr().Set(joints)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda s, b: b.GetJointIndicesAttr().Set([0, 1]), "jointIndices has 2 values"),
        (lambda s, b: b.GetJointWeightsAttr().Set([1.0]), "jointWeights has 1 values"),
        (lambda s, b: b.GetJointIndicesAttr().Set([0, 3] * 54), "joint index 3 is out of range"),
        (lambda s, b: b.GetJointIndicesAttr().Set([0, -1] * 54), "joint index -1 is out of range"),
        (lambda s, b: b.GetJointWeightsAttr().Set([math.nan] * 108), "NaN"),
        (lambda s, b: b.GetJointWeightsAttr().Clear(), "jointWeights"),
        (lambda s, b: b.GetJointWeightsPrimvar().SetElementSize(1), "elementSize"),
        (lambda s, b: b.GetSkeletonRel().SetTargets(["/Nowhere"]), "/Nowhere does not exist"),
        (lambda s, b: b.GetSkeletonRel().SetTargets([CHARACTER]), "is no Skeleton"),
        (lambda s, b: b.GetSkeletonRel().ClearTargets(True), "no skel:skeleton"),
        (lambda s, b: b.GetPrim().RemoveAPI(UsdSkel.BindingAPI), "SkelBindingAPI is not applied"),
        (lambda s, b: b.CreateJointsAttr(["A", "X", "Y"]), "joint X is none of"),
        (lambda s, b: set_bind(s, [Gf.Matrix4d(0)] * 3), "cannot be inverted"),
        (lambda s, b: set_bind(s, [Gf.Matrix4d(1)]), "bindTransform"),
        (lambda s, b: set_joints(s, ["A/B", "A", "A/B/C"]), "no valid joints"),
    ],
)
def test_a_broken_binding_is_reported_and_at_rest(stage: Usd.Stage, damage: Break, says: str) -> None:
    add_character(stage)
    api = UsdSkel.BindingAPI(add_tube(stage))
    damage(stage, api)
    translation = translate(stage, time=Usd.TimeCode(3))
    (report,) = translation.reports.errors
    assert (report.kind, report.path) == ("bad skinning", MESH)
    assert says in report.message
    np.testing.assert_array_equal(meshes(translation)[MESH]["points"], rest(stage))
    with pytest.raises(StageError, match=MESH):
        translate(stage, time=Usd.TimeCode(3), strict=True)


def test_a_singular_bind_transform_of_another_joint_does_not_matter(stage: Usd.Stage) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    expected = world(translate(stage, time=Usd.TimeCode(3)), MESH)
    skeleton = UsdSkel.Skeleton.Get(stage, SKELETON)
    skeleton.GetJointsAttr().Set(["A", "A/B", "A/B/C", "A/D"])
    set_bind(stage, [shift(0, 0, 0), shift(0, 1, 0), shift(0, 2, 0), Gf.Matrix4d(0)])
    skeleton.GetRestTransformsAttr().Set([shift(0, 0, 0), shift(0, 1, 0), shift(0, 1, 0), shift(1, 1, 1)])
    translation = translate(stage, time=Usd.TimeCode(3))
    assert not translation.reports.has_errors
    np.testing.assert_allclose(world(translation, str(mesh.GetPath())), expected, **CLOSE)


def test_a_missing_animation_is_reported_and_the_skeleton_at_rest(stage: Usd.Stage) -> None:
    add_character(stage)
    add_tube(stage)
    UsdSkel.BindingAPI(stage.GetPrimAtPath(SKELETON)).GetAnimationSourceRel().SetTargets(["/Nowhere"])
    translation = translate(stage, time=Usd.TimeCode(3))
    (report,) = translation.reports.errors
    assert (report.kind, report.path) == ("bad skeleton animation", SKELETON)
    np.testing.assert_allclose(
        world(translation, MESH), world(translate(stage, time=Usd.TimeCode(1)), MESH), **CLOSE
    )


def test_a_pose_that_is_not_finite(stage: Usd.Stage) -> None:
    add_character(stage)
    add_tube(stage)
    translations = UsdSkel.Animation.Get(stage, ANIMATION).GetTranslationsAttr()
    translations.Set([(math.nan, 0, 0)] * 3)
    translation = translate(stage, time=Usd.TimeCode(3))
    assert [(r.kind, r.path) for r in translation.reports.errors] == [("bad skinning", MESH)]
    np.testing.assert_array_equal(meshes(translation)[MESH]["points"], rest(stage))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda m, s: s.GetPointIndicesAttr().Set([1, 2, 99]), "out of range"),
        (lambda m, s: s.GetOffsetsAttr().Set([(0, 0, 1)]), "1 offsets for 3 points"),
        (lambda m, s: s.GetOffsetsAttr().Set([(0, 0, math.inf)] * 3), "infinite"),
        (lambda m, s: s.GetPrim().SetActive(False), "does not exist"),
        (lambda m, s: s.GetPrim().SetTypeName("Xform"), "is no BlendShape"),
        (lambda m, s: UsdSkel.BindingAPI(m).GetBlendShapesAttr().Set(["smile"]), "1 names"),
    ],
)
def test_a_broken_blend_shape_is_reported_and_the_rest_works(
    stage: Usd.Stage, damage: Callable[[UsdGeom.Mesh, UsdSkel.BlendShape], object], says: str
) -> None:
    add_character(stage)
    mesh = add_tube(stage)
    add_shapes(stage, mesh)
    damage(mesh, UsdSkel.BlendShape.Get(stage, f"{MESH}/wink"))
    translation = translate(stage, time=Usd.TimeCode(2))
    (report,) = translation.reports.errors
    assert report.kind.startswith("bad blend shape") and report.path == MESH and says in report.message
    animation = UsdSkel.Animation.Get(stage, ANIMATION)
    left = [0.0, 0.0, 0.0] if "names" in says else [0.0, 0.0, 0.3]
    mesh.GetPrim().RemoveProperty("skel:blendShapeTargets")
    mesh.GetPrim().RemoveProperty("skel:blendShapes")
    stage.RemovePrim(f"{MESH}/wink")
    stage.RemovePrim(f"{MESH}/smile")
    animation.GetBlendShapeWeightsAttr().Clear()
    add_shapes(stage, mesh)
    weigh(stage, ["wink", "unused", "smile"], left, left, left)
    expected = translate(stage, time=Usd.TimeCode(2))
    assert not expected.reports.has_errors
    np.testing.assert_allclose(world(translation, MESH), world(expected, MESH), **CLOSE)


def test_outside_of_a_skel_root_nothing_is_skinned(stage: Usd.Stage) -> None:
    add_character(stage)
    add_tube(stage, "/World/Mesh")
    translation = translate(stage, time=Usd.TimeCode(3))
    assert kinds(translation)["skinning outside of a SkelRoot"] == 1
    assert not translation.reports.has_errors
    np.testing.assert_array_equal(meshes(translation)["/World/Mesh"]["points"], rest(stage, "/World/Mesh"))


def test_face_indices_out_of_range_are_still_told(stage: Usd.Stage) -> None:
    add_character(stage)
    UsdGeom.Cube.Define(stage, "/World/Cube")
    mesh = add_tube(stage)
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 999] * (len(mesh.GetFaceVertexCountsAttr().Get())))
    mesh.SetNormalsInterpolation("faceVarying")
    mesh.GetNormalsAttr().Set([(0, 1, 0)] * (4 * len(mesh.GetFaceVertexCountsAttr().Get())))
    assert kinds(translate(stage, time=Usd.TimeCode(3)))["bad mesh"] == 1
