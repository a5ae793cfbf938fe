"""PointInstancers and native instances: masks, orientations, extrapolation, and prototypes of all kinds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from stages import (
    add_instance,
    add_point_instancer,
    add_square,
    expected_points,
    instances,
    kinds,
    placed_points,
    translate,
)


@pytest.fixture
def instancer(stage: Usd.Stage) -> UsdGeom.PointInstancer:
    """/World/PI with four instances of the square /World/PI/Protos/Square."""
    add_square(stage, "/World/PI/Protos/Square")
    return add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Square"], [0] * 4)


def places(stage: Usd.Stage, **options: Any) -> dict[str, list[float]]:
    """Where instances are, by what follows /World/."""
    found = instances(translate(stage, **options))
    return {p.removeprefix("/World/"): i["to_world"][3, :3].tolist() for p, i in found.items()}


def assert_placed(stage: Usd.Stage) -> None:
    np.testing.assert_allclose(placed_points(translate(stage)), expected_points(stage), rtol=1e-5, atol=2e-3)


# Masks


def test_without_ids_masks_count_instances(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    instancer.CreateInvisibleIdsAttr([1])
    instancer.DeactivateId(3)
    assert set(places(stage)) == {"PI[0]", "PI[2]"}


def test_ids_that_do_not_exist_mask_nothing(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    instancer.CreateIdsAttr([7, 5, 3, 1])
    instancer.CreateInvisibleIdsAttr([0, 2, 5])
    assert set(places(stage)) == {"PI[7]", "PI[3]", "PI[1]"}


def test_masks_over_time(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    attribute = instancer.CreateInvisibleIdsAttr()
    attribute.Set([0, 1], 1)
    attribute.Set([2], 2)
    assert set(places(stage, time=Usd.TimeCode(1))) == {"PI[2]", "PI[3]"}
    assert set(places(stage, time=Usd.TimeCode(2))) == {"PI[0]", "PI[1]", "PI[3]"}


def test_all_masked(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    add_square(stage, "/World/Seen")
    instancer.CreateInvisibleIdsAttr([0, 1, 2, 3])
    assert set(places(stage)) == {"Seen"}


def test_visibility_of_native_instances_over_time(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Square")
    for i in range(3):
        add_instance(stage, f"/World/Group{i % 2}/I{i}")
    visibility = UsdGeom.Imageable(stage.GetPrimAtPath("/World/Group0/I0")).CreateVisibilityAttr()
    visibility.Set("invisible", 1)
    visibility.Set("inherited", 2)
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Group1")).CreateVisibilityAttr().Set("invisible", 2)
    # Before a sample, and where there is no default, it holds.
    assert set(places(stage, time=Usd.TimeCode(1))) == {"Group0/I2"}
    assert set(places(stage, time=Usd.TimeCode(2))) == {"Group0/I0", "Group0/I2"}


# Transforms


def test_float_orientations_win_over_half_ones(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    instancer.CreateOrientationsAttr([Gf.Quath(0, 1, 0, 0)] * 4)
    turn = Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), 12.345).GetQuat())
    instancer.CreateOrientationsfAttr([turn] * 4)
    matrix = instances(translate(stage))["/World/PI[0]"]["to_world"]
    angle = np.degrees(np.arctan2(matrix[0, 1], matrix[0, 0]))
    assert angle == pytest.approx(12.345, abs=1e-5)
    assert_placed(stage)


def test_half_orientations_alone(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    instancer.CreateOrientationsAttr([Gf.Quath(0.5, 0.5, 0.5, 0.5)] * 4)
    matrix = instances(translate(stage))["/World/PI[0]"]["to_world"]
    np.testing.assert_allclose(matrix[0, :3], [0, 1, 0], atol=1e-3)
    assert_placed(stage)


@pytest.mark.parametrize("accelerates", [False, True])
def test_places_between_samples_come_from_velocities(stage: Usd.Stage, accelerates: bool) -> None:
    """At frame 13, 3 frames (1/8 s) after the sample: p + v t + a t² / 2."""
    stage.SetTimeCodesPerSecond(24)
    add_square(stage, "/World/PI/Protos/Square")
    add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Square"], [0])
    for name, value in (("positions", (1, 2, 3)), ("velocities", (8, 0, 0)), ("accelerations", (0, 64, 0))):
        if name != "accelerations" or accelerates:
            stage.GetPrimAtPath("/World/PI").GetAttribute(name).Set(Vt.Vec3fArray([value]), 10)
    found = places(stage, time=Usd.TimeCode(13))["PI[0]"]
    np.testing.assert_allclose(found, [1 + 8 / 8, 2 + (64 / 64 / 2 if accelerates else 0), 3], rtol=1e-6)


def test_angular_velocities_turn_between_samples(stage: Usd.Stage) -> None:
    stage.SetTimeCodesPerSecond(24)
    add_square(stage, "/World/PI/Protos/Square")
    instancer = add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Square"], [0])
    instancer.CreateOrientationsfAttr().Set([Gf.Quatf(1)], 10)
    instancer.CreateAngularVelocitiesAttr().Set([(0, 0, 80)], 10)  # degrees per second
    matrix = instances(translate(stage, time=Usd.TimeCode(13)))["/World/PI[0]"]["to_world"]
    assert np.degrees(np.arctan2(matrix[0, 1], matrix[0, 0])) == pytest.approx(10, abs=1e-4)


def test_counts_over_time(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    """Each frame has the instances of its own samples, and primvars of other lengths are said to be wrong."""
    positions = [(float(x), 0.0, 0.0) for x in range(5)]
    color = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex"
    )
    for time, count in ((1, 2), (2, 5), (3, 0)):
        instancer.GetProtoIndicesAttr().Set([0] * count, time)
        instancer.GetPositionsAttr().Set(Vt.Vec3fArray(positions[:count]), time)
    color.Set([(1, 0, 0)] * 2, 1)
    add_square(stage, "/World/Seen")
    for time, count in ((1, 2), (2, 5), (3, 0)):
        translation = translate(stage, time=Usd.TimeCode(time))
        found = instances(translation)
        assert set(found) == {"/World/Seen", *(f"/World/PI[{i}]" for i in range(count))}
        colored = [i for p, i in found.items() if p != "/World/Seen" and i["primvars"]]
        assert len(colored) == (2 if time == 1 else 0)
        assert ("bad primvar displayColor" in kinds(translation)) == (time == 2)


# Prototypes


def test_prototypes_outside_of_the_instancer_are_seen_themselves(stage: Usd.Stage) -> None:
    """Without the ancestors' transforms where they are placed."""
    UsdGeom.Xform.Define(stage, "/World/Library").AddTranslateOp().Set((0, 500, 0))
    add_square(stage, "/World/Library/Square").AddTranslateOp().Set((0, 0, 3))
    add_point_instancer(stage, "/World/PI", ["/World/Library/Square"], [0, 0])
    assert places(stage) == {
        "Library/Square": [0, 500, 3],
        "PI[0]": [10, 0, 3],
        "PI[1]": [20, 0, 3],
    }
    assert translate(stage).counts["instances"] == 3
    assert_placed(stage)


def test_purposes_of_prototypes(stage: Usd.Stage) -> None:
    paths = [f"/World/PI/Protos/{name}" for name in ("Plain", "Render", "Guide")]
    for path in paths:
        add_square(stage, path)
    for path, purpose in zip(paths[1:], ("render", "guide"), strict=True):
        UsdGeom.Imageable(stage.GetPrimAtPath(path)).CreatePurposeAttr(purpose)
    add_point_instancer(stage, "/World/PI", paths, [0, 1, 2])
    assert set(places(stage)) == {"PI[0]"}
    assert set(places(stage, purposes=("default", "render"))) == {"PI[0]", "PI[1]"}


def test_invisible_prims_inside_of_prototypes(stage: Usd.Stage) -> None:
    add_square(stage, "/World/PI/Protos/Pair/A")
    add_square(stage, "/World/PI/Protos/Pair/B").AddTranslateOp().Set((0, 5, 0))
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/PI/Protos/Pair/A")).MakeInvisible()
    add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Pair"], [0, 0])
    assert places(stage) == {"PI[0]": [10, 5, 0], "PI[1]": [20, 5, 0]}


def test_an_instancer_above_invisible_prims_hides_all(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Seen")
    add_square(stage, "/Library/Square")
    add_point_instancer(stage, "/World/Hidden/PI", ["/Library/Square"], [0, 0])
    UsdGeom.Xform.Define(stage, "/World/Hidden")
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Hidden")).MakeInvisible()
    assert set(instances(translate(stage))) == {"/World/Seen", "/Library/Square"}


def test_inactive_prototypes_are_not_placed(stage: Usd.Stage) -> None:
    add_square(stage, "/World/PI/Protos/Square")
    add_square(stage, "/World/PI/Protos/Other")
    targets = ["/World/PI/Protos/Other", "/World/PI/Protos/Square"]
    add_point_instancer(stage, "/World/PI", targets, [0, 1])
    stage.GetPrimAtPath("/World/PI/Protos/Other").SetActive(False)
    translation = translate(stage)
    assert set(instances(translation)) == {"/World/PI[1]"}
    (report,) = [r for r in translation.reports if r.kind == "inactive prototype"]
    assert report.path == "/World/PI" and "/World/PI/Protos/Other" in report.message


def test_unloaded_prototypes_are_not_placed(stage: Usd.Stage, tmp_path: Any) -> None:
    payload = Usd.Stage.CreateNew(str(tmp_path / "payload.usda"))
    payload.SetDefaultPrim(add_square(payload, "/Square").GetPrim())
    payload.Save()
    opened = Usd.Stage.CreateInMemory(load=Usd.Stage.LoadNone)
    add_square(opened, "/World/Seen")
    prim = opened.DefinePrim("/World/PI/Protos/Square")
    prim.GetPayloads().AddPayload(str(tmp_path / "payload.usda"))
    add_point_instancer(opened, "/World/PI", ["/World/PI/Protos/Square"], [0, 0])
    translation = translate(opened)
    assert set(instances(translation)) == {"/World/Seen"}
    assert kinds(translation)["unloaded prototype"] == 1
    opened.Load("/World/PI/Protos/Square")
    assert set(places(opened)) == {"Seen", "PI[0]", "PI[1]"}


def test_instanceable_prototypes_share_what_native_instances_show(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/A")
    add_square(stage, "/Asset/B").AddTranslateOp().Set((0, 2, 0))
    for path in ("/World/PI/Protos/I", "/World/PI/Protos/J", "/World/Free"):
        add_instance(stage, path)
    add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/I", "/World/PI/Protos/J"], [0, 1, 0])
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1 and translation.counts["meshes"] == 2
    assert translation.counts["instances"] == 4
    assert_placed(stage)


def test_point_in_native_in_point(stage: Usd.Stage) -> None:
    """Three levels: 3 × 1 × 2 × 1 places of a square, and 3 of one beside the inner instancer."""
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/PI/Protos/Square").AddScaleOp().Set((0.5, 0.5, 0.5))
    inner = add_point_instancer(stage, "/Asset/PI", ["/Asset/PI/Protos/Square"], [0, 0])
    inner.GetPositionsAttr().Set([(0, 1, 0), (0, 2, 0)])
    add_square(stage, "/Asset/Beside")
    native = UsdGeom.Xform.Define(stage, "/World/PI/Protos/I")
    native.AddRotateZOp().Set(30)
    native.GetPrim().GetReferences().AddInternalReference("/Asset")
    native.GetPrim().SetInstanceable(True)
    outer = add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/I"], [0, 0, 0])
    outer.AddScaleOp().Set((2, 1, 1))
    translation = translate(stage)
    assert translation.counts["meshes"] == 2 and translation.counts["instances"] == 9
    assert_placed(stage)


def test_prototypes_that_are_named_twice(stage: Usd.Stage) -> None:
    add_square(stage, "/World/PI/Protos/Square")
    add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Square"], [0, 0])
    other = add_point_instancer(stage, "/World/Other", ["/World/PI/Protos/Square"], [0])
    other.GetPositionsAttr().Set([(0, 7, 0)])
    translation = translate(stage)
    assert translation.counts["meshes"] == 1 and translation.counts["prototypes"] == 1
    assert set(instances(translation)) == {"/World/PI[0]", "/World/PI[1]", "/World/Other[0]"}
