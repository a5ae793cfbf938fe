"""Edits and times that reach what is translated by a detour: the next sync must see them all the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from coverage_probes import SKEL
from encore.dump import dump
from encore.render_index import RenderIndex, SyncOptions
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdSkel, Vt
from stages import add_square


def check(index: RenderIndex, time: float, before: str) -> None:
    """The index comes to another scene than before, and a new index comes to the same one."""
    found = dump(index.sync(Usd.TimeCode(time)))
    assert found != before
    assert found == dump(RenderIndex(index.stage, index.options).sync(Usd.TimeCode(time)))


@pytest.fixture
def skinned_instances() -> Usd.Stage:
    """Two instances of one skinned model."""
    stage = Usd.Stage.CreateInMemory()
    layer = stage.GetRootLayer()
    assert layer.ImportFromString(f'#usda 1.0\nclass Xform "_model" {{\n{SKEL["Skeleton"].stage}\n}}\n')
    # Paths of the model are those of the class.
    text = layer.ExportToString().replace("/World/", "/_model/")
    assert layer.ImportFromString(text)
    for name in ("I0", "I1"):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim()
        prim.GetInherits().AddInherit("/_model")
        prim.SetInstanceable(True)
    return stage


@pytest.mark.parametrize("edited", ["animation", "weights", "offsets", "rest", "bind", "transform"])
def test_what_poses_an_instanced_mesh(skinned_instances: Usd.Stage, edited: str) -> None:
    stage = skinned_instances
    index = RenderIndex(stage, SyncOptions())
    before = dump(index.sync(Usd.TimeCode(0)))
    root = stage.GetPrimAtPath("/_model/root")
    animation = UsdSkel.Animation(root.GetChild("animation"))
    skeleton = UsdSkel.Skeleton(root.GetChild("skeleton"))
    if edited == "animation":
        animation.GetTranslationsAttr().Set([(0, 3, 0)])
    elif edited == "weights":
        animation.GetBlendShapeWeightsAttr().Set([1.0])
    elif edited == "offsets":
        UsdSkel.BlendShape(root.GetPrimAtPath("mesh/lift")).GetOffsetsAttr().Set([(0, 0, 2)])
    elif edited == "rest":
        moved = Gf.Matrix4d(1).SetTranslate((0, 0, 2))
        skeleton.GetRestTransformsAttr().Set(Vt.Matrix4dArray([moved, Gf.Matrix4d(1)]))
    elif edited == "bind":
        moved = Gf.Matrix4d(1).SetTranslate((0, 1, 0))
        skeleton.GetBindTransformsAttr().Set(Vt.Matrix4dArray([moved, moved]))
    else:
        UsdGeom.Xformable(skeleton).AddTranslateOp().Set((0, 0, 4))
    check(index, 0, before)


CLIP = """#usda 1.0
def Xform "Model" {
    def SphereLight "light" {
        float inputs:intensity.timeSamples = { 1: 1, 2: 5 }
    }
    def PointInstancer "points" {
        point3f[] positions.timeSamples = { 1: [(0, 0, 0)], 2: [(3, 0, 0)] }
    }
}
"""
CLIPPED = """#usda 1.0
def Xform "Model" (
    clips = {
        dictionary default = {
            string primPath = "/Model"
            asset[] assetPaths = [@clip.usda@]
            asset manifestAssetPath = @manifest.usda@
            double2[] active = [(0, 0)]
            double2[] times = [(0, 0), (10, 10)]
        }
    }
) {
    def SphereLight "light" { }
    def PointInstancer "points" {
        rel prototypes = </Model/points/ball>
        int[] protoIndices = [0]
        def Sphere "ball" { }
    }
    def Sphere "ground" { }
}
"""
MANIFEST = """#usda 1.0
def Xform "Model" {
    def SphereLight "light" {
        float inputs:intensity
    }
    def PointInstancer "points" {
        point3f[] positions
    }
}
"""


def test_what_only_value_clips_say(tmp_path: Path) -> None:
    for name, text in (("clip", CLIP), ("manifest", MANIFEST), ("stage", CLIPPED)):
        (tmp_path / f"{name}.usda").write_text(text, encoding="utf-8")
    stage = Usd.Stage.Open(str(tmp_path / "stage.usda"))
    index = RenderIndex(stage, SyncOptions())
    first = index.sync(Usd.TimeCode(1))
    assert first.scene.light(0)["radiance"] == pytest.approx((1, 1, 1))
    check(index, 2, dump(first))
    second = index.sync(Usd.TimeCode(2)).scene
    assert second.light(0)["radiance"] == pytest.approx((5, 5, 5))
    places = [second.instance(i)["to_world"][3][0] for i in range(second.instance_count)]
    assert 3.0 in places


def test_the_size_of_a_light_and_the_view_that_frames_it() -> None:
    stage = Usd.Stage.CreateInMemory()
    add_square(stage, "/square")
    light = UsdLux.RectLight.Define(stage, "/light")
    index = RenderIndex(stage, SyncOptions())
    before = index.sync().scene.camera["to_world"]
    text = dump(index.sync())
    light.CreateWidthAttr(50)
    found = index.sync()
    assert dump(found) == dump(RenderIndex(stage, SyncOptions()).sync()) != text
    assert (found.scene.camera["to_world"] != before).any()


def test_indices_of_an_inherited_primvar_vary() -> None:
    stage = Usd.Stage.CreateInMemory()
    parent = UsdGeom.Xform.Define(stage, "/parent")
    add_square(stage, "/parent/square")
    color = UsdGeom.PrimvarsAPI(parent).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.constant
    )
    color.Set([(1, 0, 0), (0, 1, 0)])
    color.CreateIndicesAttr().Set(Vt.IntArray([0]), 1)
    color.GetIndicesAttr().Set(Vt.IntArray([1]), 2)
    stage.SetEndTimeCode(2)
    index = RenderIndex(stage, SyncOptions())
    check(index, 2, dump(index.sync(Usd.TimeCode(1))))


def test_a_primvar_of_an_instance_that_is_geometry_itself() -> None:
    stage = Usd.Stage.CreateInMemory()
    add_square(stage, "/_square").GetPrim().SetSpecifier(Sdf.SpecifierClass)
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    mesh.GetPrim().GetInherits().AddInherit("/_square")
    mesh.GetPrim().SetInstanceable(True)
    mesh.CreateDisplayColorAttr([(1, 0, 0)])
    index = RenderIndex(stage, SyncOptions())
    before = dump(index.sync())
    for color in ((0, 1, 0), (0, 0, 1)):
        mesh.GetDisplayColorAttr().Set([color])
        found = dump(index.sync())
        assert found == dump(RenderIndex(stage, SyncOptions()).sync()) != before
        before = found
