"""Materials: constants, bindings, cut-outs, fallbacks, and what is reported."""

import math

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from stages import (
    add_material,
    add_square,
    add_strip,
    bind,
    instances,
    kinds,
    material_name,
    materials,
    meshes,
    new_stage,
    square_with,
    surface,
    translate,
)

CONSTANTS = {
    "diffuseColor": (0.1, 0.2, 0.3),
    "emissiveColor": (1.0, 2.0, 3.0),
    "specularColor": (0.5, 0.25, 0.125),
    "metallic": 0.25,
    "roughness": 0.75,
    "clearcoat": 0.5,
    "clearcoatRoughness": 0.125,
    "opacity": 0.5,
    "ior": 1.25,
}
SNAKE = {
    "diffuseColor": "diffuse_color",
    "emissiveColor": "emissive_color",
    "specularColor": "specular_color",
}
SNAKE["clearcoatRoughness"] = "clearcoat_roughness"


def test_constant_inputs(stage: Usd.Stage) -> None:
    square_with(stage, **CONSTANTS, useSpecularWorkflow=1)
    translation = translate(stage)
    found = materials(translation)["/World/Material"]
    assert found["use_specular_workflow"] is True
    for name, value in CONSTANTS.items():
        source = found["inputs"][SNAKE.get(name, name)]
        assert source["node"] == -1
        np.testing.assert_allclose(source["value"], value, rtol=1e-6)
    assert material_name(translation, "/World/Mesh") == "/World/Material"


def test_defaults_are_the_specifications(stage: Usd.Stage) -> None:
    square_with(stage)
    found = materials(translate(stage))["/World/Material"]
    values = {name: source["value"] for name, source in found["inputs"].items()}
    assert values == {
        "diffuse_color": pytest.approx((0.18, 0.18, 0.18)),
        "emissive_color": (0, 0, 0),
        "specular_color": (0, 0, 0),
        "metallic": 0,
        "roughness": 0.5,
        "clearcoat": 0,
        "clearcoat_roughness": pytest.approx(0.01),
        "opacity": 1,
        "ior": 1.5,
        "normal": (0, 0, 1),
        "displacement": 0,
    }


def test_constants_through_interfaces(stage: Usd.Stage) -> None:
    material = square_with(stage)
    graph = UsdShade.NodeGraph.Define(stage, "/World/Material/Graph")
    outer = material.CreateInput("tint", Sdf.ValueTypeNames.Color3f)
    outer.Set((0.9, 0.8, 0.7))
    inner = graph.CreateInput("tint", Sdf.ValueTypeNames.Color3f)
    inner.ConnectToSource(outer)
    surface(material).CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(inner)
    surface(material).CreateInput("roughness", Sdf.ValueTypeNames.Float).ConnectToSource(
        material.CreateInput("rough", Sdf.ValueTypeNames.Float)
    )
    material.GetInput("rough").Set(0.25)
    found = materials(translate(stage))["/World/Material"]["inputs"]
    assert found["diffuse_color"]["value"] == pytest.approx((0.9, 0.8, 0.7))
    assert found["roughness"]["value"] == 0.25


def test_the_surface_may_come_through_a_node_graph(stage: Usd.Stage) -> None:
    material = UsdShade.Material.Define(stage, "/World/Material")
    graph = UsdShade.NodeGraph.Define(stage, "/World/Material/Graph")
    shader = UsdShade.Shader.Define(stage, "/World/Material/Graph/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(2.0)
    output = graph.CreateOutput("out", Sdf.ValueTypeNames.Token)
    output.ConnectToSource(shader.ConnectableAPI(), "surface")
    material.CreateSurfaceOutput().ConnectToSource(output)
    bind(add_square(stage, "/World/Mesh"), material)
    assert materials(translate(stage))["/World/Material"]["inputs"]["ior"]["value"] == 2


def test_time_samples(stage: Usd.Stage) -> None:
    material = square_with(stage, roughness=0.0)
    attribute = surface(material).GetInput("roughness").GetAttr()
    attribute.Set(0.0, 1)
    attribute.Set(1.0, 5)
    found = materials(translate(stage, time=Usd.TimeCode(2)))["/World/Material"]
    assert found["inputs"]["roughness"]["value"] == 0.25


@pytest.mark.parametrize(
    ("name", "value", "kind", "used"),
    [
        ("roughness", math.nan, "bad roughness", 0.5),
        ("diffuseColor", (0.0, math.inf, 0.0), "bad diffuseColor", (0.18, 0.18, 0.18)),
        ("roughness", -0.5, "bad roughness", 0.0),
        ("metallic", 2.0, "bad metallic", 1.0),
        ("ior", 0.0, "bad ior", 1.5),
        ("ior", -1.0, "bad ior", 1.5),
    ],
)
def test_bad_constants(stage: Usd.Stage, name: str, value: object, kind: str, used: object) -> None:
    square_with(stage, **{name: value})
    translation = translate(stage)
    found = materials(translation)["/World/Material"]["inputs"][SNAKE.get(name, name)]
    assert found["value"] == pytest.approx(used)
    assert kinds(translation)[kind] == 1
    translation.scene.validate()


def test_occlusion_is_ignored_as_the_specification_says(stage: Usd.Stage) -> None:
    square_with(stage, occlusion=0.5)
    translation = translate(stage)
    assert "occlusion" not in materials(translation)["/World/Material"]["inputs"]
    assert not kinds(translation).keys() - {"camera"}


@pytest.mark.parametrize(("mode", "used"), [("transparent", "transparent"), ("presence", "presence")])
def test_opacity_modes(stage: Usd.Stage, mode: str, used: str) -> None:
    square_with(stage, opacity=0.5, opacityMode=mode)
    translation = translate(stage)
    assert materials(translation)["/World/Material"]["opacity_mode"] == used
    assert not kinds(translation).keys() - {"camera"}


def test_an_unknown_opacity_mode(stage: Usd.Stage) -> None:
    square_with(stage, opacityMode="ghost")
    translation = translate(stage)
    assert materials(translation)["/World/Material"]["opacity_mode"] == "transparent"
    assert kinds(translation)["opacityMode"] == 1


@pytest.mark.parametrize(("value", "used"), [(3, 3), (-2, -2), (None, 0)])
def test_dielectric_priority(stage: Usd.Stage, value: int | None, used: int) -> None:
    material = square_with(stage, opacity=0.0)
    if value is not None:
        material.CreateInput("encore:dielectricPriority", Sdf.ValueTypeNames.Int).Set(value)
    translation = translate(stage)
    assert materials(translation)["/World/Material"]["dielectric_priority"] == used
    assert "bad dielectricPriority" not in kinds(translation)


def test_a_bad_dielectric_priority(stage: Usd.Stage) -> None:
    material = square_with(stage, opacity=0.0)
    material.CreateInput("encore:dielectricPriority", Sdf.ValueTypeNames.Float).Set(1.5)
    translation = translate(stage)
    assert materials(translation)["/World/Material"]["dielectric_priority"] == 0
    assert kinds(translation)["bad dielectricPriority"] == 1


# Bindings


def test_direct_bindings_are_inherited(stage: Usd.Stage) -> None:
    outer, inner = add_material(stage, "/World/Outer"), add_material(stage, "/World/Inner")
    for path in ("/World/G/A", "/World/G/B"):
        add_square(stage, path)
    bind(stage.GetPrimAtPath("/World/G"), outer)
    bind(stage.GetPrimAtPath("/World/G/B"), inner)
    translation = translate(stage)
    assert material_name(translation, "/World/G/A") == "/World/Outer"
    assert material_name(translation, "/World/G/B") == "/World/Inner"
    bind(stage.GetPrimAtPath("/World/G"), outer, UsdShade.Tokens.strongerThanDescendants)
    assert material_name(translate(stage), "/World/G/B") == "/World/Outer"


def test_collection_bindings(stage: Usd.Stage) -> None:
    red = add_material(stage, "/World/Red")
    for path in ("/World/A", "/World/B"):
        add_square(stage, path)
    world = stage.GetPrimAtPath("/World")
    collection = Usd.CollectionAPI.Apply(world, "some")
    collection.IncludePath("/World/B")
    UsdShade.MaterialBindingAPI.Apply(world).Bind(collection, red, "some")
    translation = translate(stage)
    assert material_name(translation, "/World/A") == "default"
    assert material_name(translation, "/World/B") == "/World/Red"


def test_purposes_of_bindings(stage: Usd.Stage) -> None:
    full, preview = add_material(stage, "/World/Full"), add_material(stage, "/World/Preview")
    api = UsdShade.MaterialBindingAPI.Apply(add_square(stage, "/World/Mesh").GetPrim())
    api.Bind(full, materialPurpose=UsdShade.Tokens.full)
    api.Bind(preview, materialPurpose=UsdShade.Tokens.preview)
    assert material_name(translate(stage), "/World/Mesh") == "/World/Full"
    translation = translate(stage, material_purposes=("preview",))
    assert material_name(translation, "/World/Mesh") == "/World/Preview"


def subset(mesh: UsdGeom.Mesh, name: str, faces: list[int], material: UsdShade.Material | None) -> None:
    api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    found = api.CreateMaterialBindSubset(name, faces)
    if material:
        bind(found, material)


def test_subsets(stage: Usd.Stage) -> None:
    red, blue, grey = (add_material(stage, f"/World/{n}") for n in ("Red", "Blue", "Grey"))
    mesh = add_strip(stage, "/World/Mesh")
    bind(mesh, grey)
    subset(mesh, "left", [0], red)
    subset(mesh, "right", [2, 99, -1], blue)
    other = UsdGeom.Subset.CreateGeomSubset(mesh, "other", UsdGeom.Tokens.face, [1], "components")
    bind(other, blue)
    translation = translate(stage)
    names = [material_name(translation, "/World/Mesh", face) for face in range(3)]
    assert names == ["/World/Red", "/World/Grey", "/World/Blue"]
    assert kinds(translation)["bad subset"] == 1


def test_subsets_inside_of_instances(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    mesh = add_strip(stage, "/Asset/Mesh")
    subset(mesh, "left", [0], add_material(stage, "/Asset/Red"))
    for i in range(2):
        prim = stage.DefinePrim(f"/World/I{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
    translation = translate(stage)
    assert translation.counts["meshes"] == 1
    for i in range(2):
        assert material_name(translation, f"/World/I{i}", 0).endswith("/Red")
        assert material_name(translation, f"/World/I{i}", 1) == "default"


# Cut-outs


@pytest.mark.parametrize(
    ("opacity", "threshold", "seen"), [(0.3, 0.5, False), (0.5, 0.5, True), (0.3, 0.0, True)]
)
def test_cut_out_meshes(stage: Usd.Stage, opacity: float, threshold: float, seen: bool) -> None:
    add_square(stage, "/World/Other")
    square_with(stage, opacity=opacity, opacityThreshold=threshold)
    translation = translate(stage)
    assert ("/World/Mesh" in instances(translation)) == seen
    if seen:
        found = materials(translation)["/World/Material"]["inputs"]["opacity"]["value"]
        assert found == pytest.approx(1.0 if threshold else opacity), "a mask does not transmit"
    assert not translation.reports.has_errors


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_cut_out_faces(stage: Usd.Stage, scheme: str) -> None:
    mesh = add_strip(stage, "/World/Mesh", scheme)
    mesh.CreateDisplayColorPrimvar("uniform").Set([(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    if scheme != "none":
        mesh.CreateHoleIndicesAttr([0])
    subset(mesh, "gone", [1], add_material(stage, "/World/Cut", opacity=0.0, opacityThreshold=0.1))
    subset(mesh, "red", [2], add_material(stage, "/World/Red"))
    translation = translate(stage)
    translation.scene.validate()
    found = meshes(translation)["/World/Mesh"]
    if scheme == "none":
        assert found["face_vertex_indices"].tolist() == [0, 2, 3, 1, 4, 6, 7, 5]
        assert found["display_color"]["values"].tolist() == [[1, 0, 0], [0, 0, 1]]
        assert [material_name(translation, "/World/Mesh", f) for f in (0, 1)] == [
            "displayColor",
            "/World/Red",
        ]
    else:
        assert found["hole_indices"].tolist() == [0, 1], "the surface beside the hole keeps its shape"
        assert len(found["face_vertex_counts"]) == 3


def test_cut_out_instances(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Mesh")
    cut = add_material(stage, "/World/Cut", opacity=0.0, opacityThreshold=0.1)
    for i in range(2):
        prim = stage.DefinePrim(f"/World/I{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
        if i:
            bind(prim, cut)
    assert list(instances(translate(stage))) == ["/World/I0"]


# Without a supported material


def test_display_color(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Red").CreateDisplayColorAttr([(1, 0, 0)])
    add_square(stage, "/World/AlsoRed").CreateDisplayColorAttr([(1, 0, 0)])
    add_square(stage, "/World/None")
    varying = add_square(stage, "/World/Varying").CreateDisplayColorPrimvar("vertex")
    varying.Set([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)])
    translation = translate(stage)
    names = {path: material_name(translation, path) for path in instances(translation)}
    assert names == {
        "/World/Red": "displayColor(1, 0, 0)",
        "/World/AlsoRed": "displayColor(1, 0, 0)",
        "/World/None": "default",
        "/World/Varying": "displayColor",
    }
    assert translation.counts["materials"] == 3
    found = materials(translation)["displayColor"]
    assert [n["kind"] for n in found["nodes"]] == ["displayColor"]
    assert found["inputs"]["diffuse_color"]["node"] == 0
    shown = meshes(translation)
    assert shown["/World/Varying"]["display_color"]["values"].shape == (4, 3)
    assert shown["/World/Red"]["display_color"] is None, "the material has it"


def test_a_material_that_reads_display_color(stage: Usd.Stage) -> None:
    material = square_with(stage)
    reader = UsdShade.Shader.Define(stage, "/World/Material/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    shader = surface(material)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        reader.ConnectableAPI(), "result"
    )
    UsdGeom.Gprim(stage.GetPrimAtPath("/World/Mesh")).CreateDisplayColorAttr([(0, 1, 0)])
    translation = translate(stage)
    assert [n["kind"] for n in materials(translation)["/World/Material"]["nodes"]] == ["displayColor"]
    assert meshes(translation)["/World/Mesh"]["display_color"]["values"].tolist() == [[0, 1, 0]]
    reader.GetInput("varname").Set("something")
    translation = translate(stage)
    (node,) = materials(translation)["/World/Material"]["nodes"]
    assert (node["kind"], node["primvar"]) == ("primvar", "something")
    assert kinds(translation)["missing primvar something"] == 1


def test_materials_that_are_not_supported_fall_back_to_display_color() -> None:
    stage = new_stage()
    for i, identifier in enumerate(("ND_standard_surface_surfaceshader", "MdlThing", "")):
        material = UsdShade.Material.Define(stage, f"/World/M{i}")
        if identifier:
            shader = UsdShade.Shader.Define(stage, f"/World/M{i}/Surface")
            shader.CreateIdAttr(identifier)
            context = "mtlx" if identifier.startswith("ND_") else ""
            material.CreateSurfaceOutput(context).ConnectToSource(shader.ConnectableAPI(), "out")
        mesh = add_square(stage, f"/World/Mesh{i}")
        mesh.CreateDisplayColorAttr([(1, 0, 0)])
        bind(mesh, material)
    translation = translate(stage)
    assert {material_name(translation, p) for p in instances(translation)} == {"displayColor(1, 0, 0)"}
    assert kinds(translation)["no UsdPreviewSurface"] == 2
    assert kinds(translation)["shader MdlThing"] == 1
