"""Meshes that emit: which instance is the light, how bright, and what their materials make of it."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdLux
from stages import (
    add_material,
    add_point_instancer,
    add_square,
    bind,
    instances,
    kinds,
    lights,
    material_name,
    materials,
    new_stage,
    translate,
)


@pytest.fixture
def stage() -> Usd.Stage:
    stage = new_stage()
    add_square(stage, "/World/Other")
    return stage


def add_lamp(stage: Usd.Stage, path: str = "/World/Lamp") -> UsdGeom.Mesh:
    mesh = add_square(stage, path)
    UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
    light = UsdLux.LightAPI(mesh.GetPrim())
    light.CreateIntensityAttr(4.0)
    light.CreateColorAttr((1.0, 0.5, 0.25))
    return mesh


def test_the_instance_is_the_light(stage: Usd.Stage) -> None:
    add_lamp(stage)
    translation = translate(stage, camera_light=True)
    (light,) = lights(translation).values()
    assert light["kind"] == "mesh" and light["path"] == "/World/Lamp"
    assert translation.scene.instance(light["instance"])["path"] == "/World/Lamp"
    assert light["radiance"] == (4, 2, 1)
    translation.scene.validate()


def test_normalize_divides_by_the_world_area(stage: Usd.Stage) -> None:
    mesh = add_lamp(stage)
    mesh.AddScaleOp().Set((2, 3, 5))
    UsdLux.LightAPI(mesh.GetPrim()).CreateNormalizeAttr(True)
    assert lights(translate(stage))["/World/Lamp"]["radiance"] == pytest.approx((4 / 6, 2 / 6, 1 / 6))


def test_normalize_of_many_faces(stage: Usd.Stage) -> None:
    mesh = add_lamp(stage)
    mesh.CreatePointsAttr([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 3)])
    mesh.CreateFaceVertexCountsAttr([4, 3, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 0, 1, 4, 0, 3, 4])
    mesh.CreateHoleIndicesAttr([2])
    UsdLux.LightAPI(mesh.GetPrim()).CreateNormalizeAttr(True)
    mesh.CreateSubdivisionSchemeAttr("catmullClark")
    assert lights(translate(stage))["/World/Lamp"]["radiance"][0] == pytest.approx(4 / (4 + 3))


def test_a_lamp_of_an_asset_is_a_light_wherever_it_is_placed(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Stand")
    add_lamp(stage, "/Asset/Bulb")
    for i in range(2):
        prim = UsdGeom.Xform.Define(stage, f"/World/I{i}")
        prim.AddTranslateOp().Set((i, 0, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Asset")
        prim.GetPrim().SetInstanceable(True)
    translation = translate(stage)
    found = lights(translation)
    assert set(found) == {"/World/I0/Bulb", "/World/I1/Bulb"}
    for path, light in found.items():
        assert translation.scene.instance(light["instance"])["path"] == path
    assert {"/World/I0", "/World/I1"} <= instances(translation).keys()
    assert translation.counts["prototypes"] == 3


def test_lamps_of_a_point_instancer(stage: Usd.Stage) -> None:
    add_lamp(stage, "/World/PI/Bulb")
    add_point_instancer(stage, "/World/PI", ["/World/PI/Bulb"], [0, 0])
    translation = translate(stage)
    assert {translation.scene.instance(v["instance"])["path"] for v in lights(translation).values()} == {
        "/World/PI[0]",
        "/World/PI[1]",
    }


def test_glow_tints_the_light(stage: Usd.Stage) -> None:
    mesh = add_lamp(stage)
    bind(mesh, add_material(stage, "/World/Glow", emissiveColor=(0.5, 1.0, 2.0)))
    assert lights(translate(stage))["/World/Lamp"]["radiance"] == (2, 2, 2)
    UsdLux.LightAPI(mesh.GetPrim()).CreateMaterialSyncModeAttr("independent")
    translation = translate(stage)
    assert lights(translation)["/World/Lamp"]["radiance"] == (4, 2, 1)
    assert material_name(translation, "/World/Lamp") == "/World/Glow"


def test_what_does_not_glow_is_not_black(stage: Usd.Stage) -> None:
    bind(add_lamp(stage), add_material(stage, "/World/Matte"))
    assert lights(translate(stage))["/World/Lamp"]["radiance"] == (4, 2, 1)


def test_no_material_response(stage: Usd.Stage) -> None:
    mesh = add_lamp(stage)
    bind(mesh, add_material(stage, "/World/Glow", emissiveColor=(0.5, 1.0, 2.0)))
    UsdLux.LightAPI(mesh.GetPrim()).CreateMaterialSyncModeAttr("noMaterialResponse")
    translation = translate(stage)
    assert lights(translation)["/World/Lamp"]["radiance"] == (4, 2, 1)
    found = materials(translation)[material_name(translation, "/World/Lamp")]
    colour = found["inputs"]["diffuse_color"]
    assert tuple(colour["value"] if isinstance(colour, dict) else colour) == (0, 0, 0)


def test_geometry_lights(stage: Usd.Stage) -> None:
    light = UsdLux.GeometryLight.Define(stage, "/World/Light")
    light.CreateIntensityAttr(3.0)
    light.AddTranslateOp().Set((100, 0, 0))
    light.CreateGeometryRel().SetTargets(["/World/Other"])
    translation = translate(stage)
    (found,) = lights(translation).values()
    assert found["kind"] == "mesh" and found["radiance"] == (3, 3, 3)
    assert translation.scene.instance(found["instance"])["path"] == "/World/Other"
    light.CreateVisibilityAttr("invisible")
    assert not lights(translate(stage))


def test_geometry_lights_without_geometry(stage: Usd.Stage) -> None:
    light = UsdLux.GeometryLight.Define(stage, "/World/Light")
    assert kinds(translate(stage))["bad light"] == 1
    light.CreateGeometryRel().SetTargets(["/World/Nothing"])
    assert kinds(translate(stage))["GeometryLight without geometry"] == 1


def test_meshes_without_area_do_not_emit(stage: Usd.Stage) -> None:
    mesh = add_lamp(stage)
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)])
    translation = translate(stage)
    assert not lights(translation) and kinds(translation)["bad light"] == 1


def test_implicit_shapes_emit_too(stage: Usd.Stage) -> None:
    sphere = UsdGeom.Sphere.Define(stage, "/World/Ball")
    UsdLux.LightAPI.Apply(sphere.GetPrim()).CreateNormalizeAttr(True)
    (light,) = lights(translate(stage)).values()
    assert light["radiance"][0] == pytest.approx(1 / (4 * np.pi), rel=1e-2)
