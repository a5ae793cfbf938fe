"""Native instances and PointInstancers: what is shared, where it is, and what it looks like."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from stages import (
    add_material,
    add_point_instancer,
    add_square,
    add_strip,
    bind,
    expected_points,
    instances,
    kinds,
    lights,
    material_name,
    meshes,
    new_stage,
    placed_points,
    translate,
)


def add_asset(stage: Usd.Stage) -> None:
    """/Asset (abstract): two meshes with transforms of their own."""
    stage.CreateClassPrim("/Asset")
    UsdGeom.Xform.Define(stage, "/Asset/Geom").AddTranslateOp().Set((0, 0, 1))
    add_square(stage, "/Asset/Geom/A").AddScaleOp().Set((2, 3, 4))
    add_strip(stage, "/Asset/Geom/B").AddTranslateOp().Set((0, 5, 0))


def add_instance(
    stage: Usd.Stage, path: str, source: str = "/Asset", at: tuple[float, float, float] = (0, 0, 0)
) -> Usd.Prim:
    prim = UsdGeom.Xform.Define(stage, path)
    prim.AddTranslateOp().Set(at)
    prim.GetPrim().GetReferences().AddInternalReference(source)
    prim.GetPrim().SetInstanceable(True)
    return prim.GetPrim()


def assert_placed(stage: Usd.Stage, **options: object) -> None:
    np.testing.assert_allclose(
        placed_points(translate(stage, **options)), expected_points(stage), rtol=1e-5, atol=2e-3
    )


def test_native_instances_share_a_prototype(stage: Usd.Stage) -> None:
    add_asset(stage)
    for i in range(5):
        add_instance(stage, f"/World/I{i}", at=(i, 0, 0))
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1
    assert translation.counts["meshes"] == 2
    assert list(instances(translation)) == [f"/World/I{i}" for i in range(5)]
    assert_placed(stage)


def test_nested_native_instances(stage: Usd.Stage) -> None:
    add_asset(stage)
    stage.CreateClassPrim("/Group")
    for i in range(3):
        add_instance(stage, f"/Group/Member{i}", at=(0, i, 0))
    add_square(stage, "/Group/Own")
    for i in range(2):
        group = add_instance(stage, f"/World/G{i}", "/Group", (10 * i, 0, 0))
        UsdGeom.Xformable(group).AddScaleOp().Set((1, -2, 1))
    translation = translate(stage)
    assert translation.counts["prototypes"] == 2
    assert translation.counts["instances"] == 2 * 3 + 2
    assert "/World/G1/Member2" in instances(translation)
    assert_placed(stage)


def test_a_single_mesh_keeps_its_own_space(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Mesh").AddTranslateOp().Set((1e8, 0.25, 0))
    add_instance(stage, "/World/I0", at=(-1e8, 0, 0))
    translation = translate(stage)
    (mesh,) = meshes(translation).values()
    assert mesh["points"].max() == 1, "not moved to where float32 has no digits left"
    assert instances(translation)["/World/I0"]["to_world"][3].tolist() == [0, 0.25, 0, 1]


def test_mirrored_meshes_of_a_prototype_turn_their_orientation(stage: Usd.Stage) -> None:
    add_asset(stage)
    stage.CreateClassPrim("/Asset")
    UsdGeom.Xformable(stage.GetPrimAtPath("/Asset/Geom/A")).GetOrderedXformOps()[0].Set((2, -3, 4))
    UsdGeom.Mesh(stage.GetPrimAtPath("/Asset/Geom/A")).CreateNormalsAttr([(0, 0.6, 0.8)] * 4)
    add_instance(stage, "/World/I")
    found = meshes(translate(stage))
    assert found["/World/I/Geom/A"]["left_handed"] and not found["/World/I/Geom/B"]["left_handed"]
    normal = found["/World/I/Geom/A"]["normals"]["values"][0]
    np.testing.assert_allclose(normal, [0, 0.6 / -3, 0.8 / 4], atol=1e-7)
    assert_placed(stage)


def test_a_reset_xform_stack_inside_an_instance(stage: Usd.Stage) -> None:
    add_asset(stage)
    UsdGeom.Xformable(stage.GetPrimAtPath("/Asset/Geom/A")).SetResetXformStack(True)
    for i in range(2):
        add_instance(stage, f"/World/I{i}", at=(i, 7, 0))
    translation = translate(stage)
    assert instances(translation)["/World/I1/Geom/A"]["to_world"][3, :3].tolist() == [0, 0, 0]
    assert_placed(stage)


def test_invisible_instances(stage: Usd.Stage) -> None:
    add_asset(stage)
    for i in range(3):
        add_instance(stage, f"/World/I{i}", at=(i, 0, 0))
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/I1")).MakeInvisible()
    assert list(instances(translate(stage))) == ["/World/I0", "/World/I2"]


def test_purposes_of_instances(stage: Usd.Stage) -> None:
    add_asset(stage)
    for i, purpose in enumerate(("default", "render", "guide")):
        UsdGeom.Imageable(add_instance(stage, f"/World/I{i}")).CreatePurposeAttr(purpose)
    assert list(instances(translate(stage))) == ["/World/I0"]
    found = list(instances(translate(stage, purposes=("default", "render"))))
    assert found == ["/World/I0", "/World/I1"]


def test_instances_inherit_materials_and_share_geometry(stage: Usd.Stage) -> None:
    add_asset(stage)
    red, blue = add_material(stage, "/World/Red"), add_material(stage, "/World/Blue")
    for i, material in enumerate((red, blue, None, red)):
        prim = add_instance(stage, f"/World/I{i}")
        if material:
            bind(prim, material)
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1
    names = [material_name(translation, f"/World/I{i}") for i in range(4)]
    assert names == ["/World/Red", "/World/Blue", "default", "/World/Red"]


def test_bindings_inside_of_instances(stage: Usd.Stage) -> None:
    """One mesh has a material of its own, the other inherits: equal bindings share geometry."""
    add_asset(stage)
    own = add_material(stage, "/Asset/Own")
    bind(stage.GetPrimAtPath("/Asset/Geom/A"), own)
    red, blue = add_material(stage, "/World/Red"), add_material(stage, "/World/Blue")
    for i, material in enumerate((red, blue, red)):
        bind(add_instance(stage, f"/World/I{i}"), material)
    translation = translate(stage)
    assert translation.counts["prototypes"] == 2
    scene = translation.scene

    def shown(path: str) -> list[str]:
        placed = instances(translation)[path]
        assert placed["material"] == -1
        found = [scene.mesh(m) for m in scene.prototype(placed["prototype"])["meshes"]]
        return [scene.material(m["material"])["path"].split("/")[-1] for m in found]

    assert shown("/World/I0") == ["Own", "Red"]
    assert shown("/World/I1") == ["Own", "Blue"]
    assert shown("/World/I2") == ["Own", "Red"]


def test_a_stronger_binding_above_an_instance(stage: Usd.Stage) -> None:
    add_asset(stage)
    bind(stage.GetPrimAtPath("/Asset/Geom/A"), add_material(stage, "/Asset/Own"))
    red = add_material(stage, "/World/Red")
    bind(add_instance(stage, "/World/I0"), red)
    bind(add_instance(stage, "/World/I1"), red, UsdShade.Tokens.strongerThanDescendants)
    translation = translate(stage)
    assert material_name(translation, "/World/I0").endswith("/Own")
    assert material_name(translation, "/World/I1") == "/World/Red"


def test_collections_reach_into_instances(stage: Usd.Stage) -> None:
    add_asset(stage)
    for i in range(3):
        add_instance(stage, f"/World/I{i}")
    red = add_material(stage, "/World/Red")
    world = stage.GetPrimAtPath("/World")
    collection = Usd.CollectionAPI.Apply(world, "some")
    collection.IncludePath("/World/I1/Geom/A")
    UsdShade.MaterialBindingAPI.Apply(world).Bind(collection, red, "some")
    translation = translate(stage)
    scene = translation.scene
    assert translation.counts["prototypes"] == 2
    for i in range(3):
        placed = instances(translation)[f"/World/I{i}"]
        found = [scene.mesh(m) for m in scene.prototype(placed["prototype"])["meshes"]]
        names = [scene.material(m["material"])["path"] for m in found]
        assert names == (["/World/Red", "default"] if i == 1 else ["default", "default"])


def test_an_instance_that_is_a_mesh_itself(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Child")
    mesh = add_square(stage, "/World/I")
    mesh.GetPrim().GetReferences().AddInternalReference("/Asset")
    mesh.GetPrim().SetInstanceable(True)
    assert translate(stage).counts["instances"] == 2
    assert_placed(stage)


# PointInstancer


def add_prototypes(stage: Usd.Stage) -> list[str]:
    add_square(stage, "/World/PI/Protos/Square").AddTranslateOp().Set((0, 0, 3))
    UsdGeom.Xform.Define(stage, "/World/PI/Protos/Pair").AddRotateZOp().Set(90)
    add_square(stage, "/World/PI/Protos/Pair/A")
    add_strip(stage, "/World/PI/Protos/Pair/B").AddTranslateOp().Set((0, 1, 0))
    return ["/World/PI/Protos/Square", "/World/PI/Protos/Pair"]


def test_point_instancer(stage: Usd.Stage) -> None:
    instancer = add_point_instancer(stage, "/World/PI", add_prototypes(stage), [0, 1, 1, 0])
    instancer.AddTranslateOp().Set((0, 100, 0))
    instancer.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0), Gf.Quath(0, 1, 0, 0)] * 2)
    instancer.CreateScalesAttr([(1, 1, 1), (2, 2, 2), (1, -1, 1), (3, 1, 1)])
    translation = translate(stage)
    assert translation.counts["prototypes"] == 2
    assert translation.counts["meshes"] == 3
    assert set(instances(translation)) == {f"/World/PI[{i}]" for i in range(4)}
    assert_placed(stage)


def test_masked_instances(stage: Usd.Stage) -> None:
    instancer = add_point_instancer(stage, "/World/PI", add_prototypes(stage), [0, 1, 1, 0, 0])
    instancer.CreateIdsAttr([10, 11, 12, 13, 14])
    instancer.CreateInvisibleIdsAttr([11])
    instancer.DeactivateId(14)
    assert set(instances(translate(stage))) == {"/World/PI[10]", "/World/PI[12]", "/World/PI[13]"}
    assert_placed(stage)


def test_prototypes_hidden_below_an_over(stage: Usd.Stage) -> None:
    add_square(stage, "/Library/Square")
    stage.GetPrimAtPath("/Library").SetSpecifier(Sdf.SpecifierOver)
    add_point_instancer(stage, "/World/PI", ["/Library/Square"], [0, 0])
    assert translate(stage).counts["instances"] == 2
    assert_placed(stage)


def test_nested_point_instancers(stage: Usd.Stage) -> None:
    add_square(stage, "/World/PI/Protos/Inner/Protos/Square")
    inner = add_point_instancer(
        stage, "/World/PI/Protos/Inner", ["/World/PI/Protos/Inner/Protos/Square"], [0, 0, 0]
    )
    inner.AddScaleOp().Set((0.1, 0.1, 0.1))
    outer = add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Inner"], [0, 0])
    outer.AddRotateYOp().Set(30)
    translation = translate(stage)
    assert translation.counts["meshes"] == 1 and translation.counts["instances"] == 6
    assert_placed(stage)


def test_point_instancer_in_a_native_instance(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/PI/Protos/Square")
    add_point_instancer(stage, "/Asset/PI", ["/Asset/PI/Protos/Square"], [0, 0])
    add_square(stage, "/Asset/Beside")
    red, blue = add_material(stage, "/World/Red"), add_material(stage, "/World/Blue")
    for i, material in enumerate((red, blue)):
        bind(add_instance(stage, f"/World/I{i}", at=(0, i, 0)), material)
    translation = translate(stage)
    assert translation.counts["meshes"] == 2 and translation.counts["instances"] == 6
    assert_placed(stage)
    found = {path: material_name(translation, path) for path in instances(translation)}
    assert set(found.values()) == {"/World/Red", "/World/Blue"}
    assert sorted(found.values()).count("/World/Red") == 3, "what is inside inherits from its own instance"
    for path, placed in instances(translation).items():
        expected = "/World/Red" if placed["to_world"][3, 1] == 0 else "/World/Blue"
        assert found[path] == expected


def test_native_instances_as_prototypes(stage: Usd.Stage) -> None:
    add_asset(stage)
    add_instance(stage, "/World/PI/Protos/I", at=(0, 0, 2))
    add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/I"], [0, 0, 0])
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1 and translation.counts["instances"] == 3
    assert_placed(stage)


def test_materials_of_prototypes(stage: Usd.Stage) -> None:
    paths = add_prototypes(stage)
    bind(stage.GetPrimAtPath(paths[0]), add_material(stage, "/World/Red"))
    bind(stage.GetPrimAtPath("/World"), add_material(stage, "/World/Grey"))
    add_point_instancer(stage, "/World/PI", paths, [0, 1])
    translation = translate(stage)
    assert material_name(translation, "/World/PI[0]") == "/World/Red"
    assert material_name(translation, "/World/PI[1]") == "/World/Grey"


def test_the_instancers_purpose_counts(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Seen")
    instancer = add_point_instancer(stage, "/World/PI", add_prototypes(stage), [0, 1])
    instancer.CreatePurposeAttr("guide")
    assert list(instances(translate(stage))) == ["/World/Seen"]


def test_an_invisible_prototype_is_not_placed(stage: Usd.Stage) -> None:
    paths = add_prototypes(stage)
    UsdGeom.Imageable(stage.GetPrimAtPath(paths[0])).MakeInvisible()
    add_point_instancer(stage, "/World/PI", paths, [0, 1])
    assert list(instances(translate(stage))) == ["/World/PI[1]"]


def test_lights_are_instanced(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Lamp")
    add_square(stage, "/Lamp/Shade")
    UsdLux.SphereLight.Define(stage, "/Lamp/Bulb").AddTranslateOp().Set((0, 0, 1))
    for i in range(2):
        add_instance(stage, f"/World/I{i}", "/Lamp", (i, 0, 0))
    found = lights(translate(stage))
    assert {p: light["centre"] for p, light in found.items()} == {
        "/World/I0/Bulb": (0, 0, 1),
        "/World/I1/Bulb": (1, 0, 1),
    }


@pytest.mark.parametrize(
    ("case", "kind", "shown"),
    [
        ("indices", "bad protoIndices", 1),
        ("positions", "bad instancer", 0),
        ("missing", "missing prototype", 1),
        ("none", "empty instancer", 0),
        ("singular", "singular transform", 1),
    ],
)
def test_broken_instancers(case: str, kind: str, shown: int) -> None:
    stage = new_stage()
    add_square(stage, "/World/Seen")
    instancer = add_point_instancer(stage, "/World/PI", add_prototypes(stage), [0, 1])
    if case == "indices":
        instancer.GetProtoIndicesAttr().Set([0, 7])
    elif case == "positions":
        instancer.GetPositionsAttr().Set([(0, 0, 0)])
    elif case == "missing":
        instancer.GetPrototypesRel().SetTargets(["/World/PI/Protos/Square", "/World/Nothing"])
    elif case == "none":
        instancer.GetPrototypesRel().ClearTargets(True)
    else:
        instancer.CreateScalesAttr([(1, 1, 1), (0, 0, 0)])
    translation = translate(stage)
    assert kinds(translation)[kind] == 1
    assert len(instances(translation)) == 1 + shown


def test_an_instancer_inside_of_its_own_prototype(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Seen")
    UsdGeom.Xform.Define(stage, "/World/Proto")
    add_square(stage, "/World/Proto/Square")
    add_point_instancer(stage, "/World/Proto/PI", ["/World/Proto"], [0, 0])
    translation = translate(stage)
    assert kinds(translation)["instancing cycle"] == 1
    assert "/World/Seen" in instances(translation)
