"""Material networks: what is connected to which input, through what, and connections that cannot be."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from stages import (
    add_material,
    add_square,
    bind,
    connect_reader,
    connect_texture,
    kinds,
    materials,
    meshes,
    square_with,
    surface,
    translate,
    write_image,
)

T = Sdf.ValueTypeNames
COLOURS = {
    "diffuseColor": "diffuse_color",
    "emissiveColor": "emissive_color",
    "specularColor": "specular_color",
}
NUMBERS = {
    "metallic": "metallic",
    "roughness": "roughness",
    "clearcoat": "clearcoat",
    "clearcoatRoughness": "clearcoat_roughness",
    "opacity": "opacity",
    "ior": "ior",
}
DEFAULTS = {"roughness": 0.5, "ior": 1.5, "opacity": 1.0, "clearcoatRoughness": 0.01}


def read(stage: Usd.Stage) -> dict[str, Any]:
    """The material /World/Material of the scene, which is valid."""
    translation = translate(stage)
    translation.scene.validate()
    return materials(translation)["/World/Material"]


def texture_of(stage: Usd.Stage, folder: Path, name: str = "Texture") -> UsdShade.Shader:
    """A UsdUVTexture that reads st, with all of its outputs."""
    material = stage.GetPrimAtPath("/World/Material")
    helper = UsdShade.Shader.Define(stage, f"{material.GetPath()}/{name}_of")
    texture = connect_texture(stage, helper, write_image(folder / "white.png"))
    stage.RemovePrim(helper.GetPath())
    for output in "rgba":
        texture.CreateOutput(output, T.Float)
    return texture


def connect(shader: UsdShade.Shader, name: str, source: UsdShade.Shader, output: str) -> UsdShade.Input:
    found = shader.GetInput(name) or shader.CreateInput(name, T.Color3f if name in COLOURS else T.Float)
    found.GetAttr().AddConnection(source.GetPath().AppendProperty(f"outputs:{output}"))
    return found


@pytest.mark.parametrize("name", [*COLOURS, *NUMBERS])
def test_every_input_takes_a_texture(stage: Usd.Stage, tmp_path: Path, name: str) -> None:
    shader = surface(square_with(stage))
    texture = texture_of(stage, tmp_path)
    if name in COLOURS:
        connect(shader, name, texture, "rgb")
        source = read(stage)["inputs"][COLOURS[name]]
        assert (source["node"], source["channel"]) == (0, 0)
        return
    for channel, output in enumerate("rgba"):
        connect(shader, name, texture, output).GetAttr().SetConnections(
            [texture.GetPath().AppendProperty(f"outputs:{output}")]
        )
        source = read(stage)["inputs"][NUMBERS[name]]
        assert (source["node"], source["channel"]) == (0, channel)
        assert source["value"] == pytest.approx(DEFAULTS.get(name, 0.0))


def test_one_node_serves_several_inputs(stage: Usd.Stage, tmp_path: Path) -> None:
    """Occlusion, roughness and metallic in one file."""
    shader = surface(square_with(stage))
    texture = texture_of(stage, tmp_path)
    for name, output in (("occlusion", "r"), ("roughness", "g"), ("metallic", "b")):
        connect(shader, name, texture, output)
    found = read(stage)
    assert len(found["nodes"]) == 1
    channels = {n: (s["node"], s["channel"]) for n, s in found["inputs"].items() if s["node"] >= 0}
    assert channels == {"roughness": (0, 1), "metallic": (0, 2)}


@pytest.mark.parametrize(
    ("target", "output"), [("diffuseColor", "r"), ("roughness", "rgb"), ("roughness", "nothing")]
)
def test_outputs_of_another_type(stage: Usd.Stage, tmp_path: Path, target: str, output: str) -> None:
    """The value that is authored beside the connection counts, and it is reported."""
    value: Any = (0.1, 0.2, 0.3) if target == "diffuseColor" else 0.625
    shader = surface(square_with(stage, **{target: value}))
    texture = texture_of(stage, tmp_path)
    texture.CreateOutput("nothing", T.Float)
    connect(shader, target, texture, output)
    found = read(stage)["inputs"][COLOURS.get(target, target)]
    assert found["node"] == -1 and found["value"] == pytest.approx(value)
    assert kinds(translate(stage))[f"connected {target}"] == 1


@pytest.mark.parametrize(
    ("kind", "target"), [("float2", "roughness"), ("float4", "diffuseColor"), ("float", "diffuseColor")]
)
def test_readers_of_another_type(stage: Usd.Stage, kind: str, target: str) -> None:
    connect_reader(stage, surface(square_with(stage)), kind, "x", target)
    assert read(stage)["inputs"][COLOURS.get(target, target)]["node"] == -1
    assert kinds(translate(stage))[f"connected {target}"] == 1


@pytest.mark.parametrize("kind", ["string", "matrix"])
def test_readers_of_what_is_no_number(stage: Usd.Stage, kind: str) -> None:
    connect_reader(stage, surface(square_with(stage)), kind, "x", "roughness")
    assert read(stage)["inputs"]["roughness"]["node"] == -1
    assert kinds(translate(stage))["connected roughness"] == 1


@pytest.mark.parametrize(
    ("kind", "target", "fallback", "four"),
    [
        ("float", "roughness", 0.25, [0.25, 0, 0, 0]),
        ("int", "metallic", 1, [1, 0, 0, 0]),
        ("float3", "diffuseColor", (1, 2, 3), [1, 2, 3, 0]),
        ("normal", "specularColor", (1, 2, 3), [1, 2, 3, 0]),
        ("float3", "diffuseColor", None, [0, 0, 0, 0]),
    ],
)
def test_primvar_nodes(stage: Usd.Stage, kind: str, target: str, fallback: object, four: list[float]) -> None:
    connect_reader(stage, surface(square_with(stage)), kind, "x", target, fallback)
    found = read(stage)
    (node,) = found["nodes"]
    assert (node["kind"], node["primvar"], node["fallback"]) == ("primvar", "x", four)
    source = found["inputs"][COLOURS.get(target, target)]
    assert (source["node"], source["channel"]) == (0, 0)


def test_display_color_with_a_fallback_is_a_primvar_like_others(stage: Usd.Stage) -> None:
    """The node of its own has none but grey."""
    connect_reader(stage, surface(square_with(stage)), "float3", "displayColor", "diffuseColor", (1, 0, 0))
    (node,) = read(stage)["nodes"]
    assert (node["kind"], node["primvar"]) == ("primvar", "displayColor")
    mesh = UsdGeom.Gprim(stage.GetPrimAtPath("/World/Mesh"))
    mesh.CreateDisplayColorAttr([(0, 1, 0)])
    (primvar,) = meshes(translate(stage))["/World/Mesh"]["primvars"]
    assert primvar["values"].tolist() == [[0, 1, 0, 0]]


def test_a_reader_without_a_name_gives_its_fallback(stage: Usd.Stage) -> None:
    connect_reader(stage, surface(square_with(stage)), "float", "", "roughness", 0.25)
    found = read(stage)
    assert found["nodes"] == [] and found["inputs"]["roughness"]["value"] == 0.25
    assert kinds(translate(stage))["no varname"] == 1


def test_connections_through_node_graphs(stage: Usd.Stage, tmp_path: Path) -> None:
    """A texture inside of a graph, its file from the material's interface, its output through the graph's."""
    material = square_with(stage)
    graph = UsdShade.NodeGraph.Define(stage, "/World/Material/Graph")
    texture = UsdShade.Shader.Define(stage, "/World/Material/Graph/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateOutput("g", T.Float)
    material.CreateInput("map", T.Asset).Set(Sdf.AssetPath(write_image(tmp_path / "white.png")))
    inner = graph.CreateInput("map", T.Asset)
    inner.ConnectToSource(material.GetInput("map"))
    texture.CreateInput("file", T.Asset).ConnectToSource(inner)
    material.CreateInput("gain", T.Float4).Set((2, 2, 2, 2))
    texture.CreateInput("scale", T.Float4).ConnectToSource(material.GetInput("gain"))
    output = graph.CreateOutput("rough", T.Float)
    output.ConnectToSource(texture.ConnectableAPI(), "g")
    surface(material).CreateInput("roughness", T.Float).ConnectToSource(output)
    found = read(stage)
    (node,) = found["nodes"]
    assert node["texture"] == 0 and node["scale"] == [2, 2, 2, 2]
    assert found["inputs"]["roughness"]["channel"] == 1


def test_transforms_in_a_row(stage: Usd.Stage, tmp_path: Path) -> None:
    """(s, t) is scaled by the one that is nearer to the primvar first."""
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    source = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface_diffuseColor_st"))
    for name, value in (("scale", (2, 4)), ("translation", (1, 0))):
        node = UsdShade.Shader.Define(stage, f"/World/Material/{name}")
        node.CreateIdAttr("UsdTransform2d")
        node.CreateInput(name, T.Float2).Set(Gf.Vec2f(value))
        node.CreateInput("in", T.Float2).ConnectToSource(source.ConnectableAPI(), "result")
        node.CreateOutput("result", T.Float2)
        source = node
    texture.GetInput("st").ConnectToSource(source.ConnectableAPI(), "result")
    (node,) = read(stage)["nodes"]
    assert node["st_transform"] == [2, 0, 1, 0, 4, 0]


def test_coordinates_fall_back_to_what_their_reader_says(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    assert kinds(translate(stage))["missing primvar st"] == 1
    reader = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface_diffuseColor_st"))
    reader.CreateInput("fallback", T.Float2).Set(Gf.Vec2f(0.25, 0.5))
    (node,) = read(stage)["nodes"]
    assert node["texcoord_fallback"] == [0.25, 0.5]
    assert "missing primvar st" not in kinds(translate(stage))


@pytest.mark.parametrize("identifier", ["UsdPrimvarReader_float3", "MyNoise", ""])
def test_what_gives_no_coordinates(stage: Usd.Stage, tmp_path: Path, identifier: str) -> None:
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    node = UsdShade.Shader.Define(stage, "/World/Material/Node")
    if identifier:
        node.CreateIdAttr(identifier)
    node.CreateOutput("result", T.Float2)
    texture.GetInput("st").ConnectToSource(node.ConnectableAPI(), "result")
    (found,) = read(stage)["nodes"]
    assert found["texcoord"] == "st"
    assert kinds(translate(stage))["texture coordinates"] == 1


@pytest.mark.parametrize("identifier", ["MyNoise", ""])
def test_unknown_nodes(stage: Usd.Stage, identifier: str) -> None:
    """Their inputs keep their own values."""
    shader = surface(square_with(stage, roughness=0.25))
    node = UsdShade.Shader.Define(stage, "/World/Material/Node")
    if identifier:
        node.CreateIdAttr(identifier)
    node.CreateOutput("result", T.Float)
    connect(shader, "roughness", node, "result")
    connect(shader, "metallic", node, "result")
    found = read(stage)["inputs"]
    assert (found["roughness"]["value"], found["metallic"]["value"]) == (0.25, 0)
    translation = translate(stage)
    assert kinds(translation)[f"shader {identifier or 'without id'}"] == 1
    assert any("/World/Material/Node" in line for line in translation.reports.lines())


def test_a_circle_of_interfaces(stage: Usd.Stage) -> None:
    material = square_with(stage, roughness=0.25)
    graph = UsdShade.NodeGraph.Define(stage, "/World/Material/Graph")
    outer, inner = material.CreateInput("x", T.Float), graph.CreateInput("x", T.Float)
    outer.ConnectToSource(inner)
    inner.ConnectToSource(outer)
    surface(material).GetInput("roughness").ConnectToSource(inner)
    assert read(stage)["inputs"]["roughness"]["value"] == 0.25
    assert kinds(translate(stage))["cyclic network"] == 1


def test_a_texture_that_reads_itself(stage: Usd.Stage, tmp_path: Path) -> None:
    shader = surface(square_with(stage))
    texture = texture_of(stage, tmp_path)
    texture.GetInput("st").ConnectToSource(texture.ConnectableAPI(), "rgb")
    connect(texture, "scale", texture, "r")
    connect(shader, "roughness", texture, "r")
    (node,) = read(stage)["nodes"]
    assert node["scale"] == [1, 1, 1, 1]
    assert {"cyclic network", "connected scale"} <= kinds(translate(stage)).keys()


def test_a_connection_to_nothing(stage: Usd.Stage) -> None:
    shader = surface(square_with(stage, roughness=0.25))
    shader.GetInput("roughness").GetAttr().AddConnection("/World/Material/Nothing.outputs:r")
    assert read(stage)["inputs"]["roughness"]["value"] == 0.25
    assert kinds(translate(stage))["broken connection"] == 1


def test_an_interface_that_says_nothing_means_the_default(stage: Usd.Stage) -> None:
    material = square_with(stage)
    surface(material).CreateInput("roughness", T.Float).ConnectToSource(material.CreateInput("x", T.Float))
    assert read(stage)["inputs"]["roughness"]["value"] == 0.5
    assert not kinds(translate(stage)).keys() - {"camera"}


def test_several_connections_of_one_input(stage: Usd.Stage, tmp_path: Path) -> None:
    shader = surface(square_with(stage))
    texture = texture_of(stage, tmp_path)
    connect(shader, "roughness", texture, "g")
    connect(shader, "roughness", texture, "b")
    connections = shader.GetInput("roughness").GetAttr().GetConnections()
    assert len(connections) == 2
    channel = {"g": 1, "b": 2}[connections[0].name.removeprefix("outputs:")]
    assert read(stage)["inputs"]["roughness"]["channel"] == channel
    assert kinds(translate(stage))["several connections"] == 1


@pytest.mark.parametrize("name", ["scale", "bias", "fallback"])
def test_nan_parameters_of_a_texture(stage: Usd.Stage, tmp_path: Path, name: str) -> None:
    shader = surface(square_with(stage))
    texture = texture_of(stage, tmp_path)
    texture.CreateInput(name, T.Float4).Set((math.nan, 1, 1, 1))
    connect(shader, "roughness", texture, "r")
    (node,) = read(stage)["nodes"]
    assert np.isfinite(node[name]).all()
    assert kinds(translate(stage))[f"bad {name}"] == 1


def test_a_nan_transform(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    node = UsdShade.Shader.Define(stage, "/World/Material/Transform")
    node.CreateIdAttr("UsdTransform2d")
    node.CreateInput("rotation", T.Float).Set(math.inf)
    node.CreateInput("in", T.Float2).Set((math.nan, 0))
    node.CreateOutput("result", T.Float2)
    texture.GetInput("st").ConnectToSource(node.ConnectableAPI(), "result")
    (found,) = read(stage)["nodes"]
    assert np.isfinite(found["st_transform"]).all()
    assert {"bad rotation", "bad in"} <= kinds(translate(stage)).keys()


def test_an_unknown_wrap_mode(stage: Usd.Stage, tmp_path: Path) -> None:
    shader = surface(square_with(stage))
    texture = texture_of(stage, tmp_path)
    texture.CreateInput("wrapS", T.Token).Set("around")
    connect(shader, "roughness", texture, "r")
    (node,) = read(stage)["nodes"]
    assert node["wrap_s"] == "black"
    assert kinds(translate(stage))["wrap mode"] == 1


# Normals, displacement, opacity


def test_normal_maps(stage: Usd.Stage, tmp_path: Path) -> None:
    shader = surface(square_with(stage))
    texture = connect_texture(stage, shader, write_image(tmp_path / "a.png"), "uv", "normal")
    assert kinds(translate(stage))["normal map"] == 1, "8 bits need scale and bias"
    texture.CreateInput("scale", T.Float4).Set((2, 2, 2, 1))
    texture.CreateInput("bias", T.Float4).Set((-1, -1, -1, 0))
    found = read(stage)
    source = found["inputs"]["normal"]
    assert (source["value"], source["node"], source["channel"]) == ((0, 0, 1), 0, 0)
    assert found["nodes"][0]["texcoord"] == "uv"
    assert "normal map" not in kinds(translate(stage))


def test_normals_that_are_no_texture_are_given_in_the_tangents_of_st(stage: Usd.Stage) -> None:
    material = square_with(stage, normal=(1.0, 0.0, 1.0))
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh"))
    api.CreatePrimvar("st", T.TexCoord2fArray, "vertex").Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    assert read(stage)["inputs"]["normal"]["value"] == (1, 0, 1)
    assert [t["name"] for t in meshes(translate(stage))["/World/Mesh"]["texcoords"]] == ["st"]
    connect_reader(stage, surface(material), "normal", "n", "normal", (0, 1, 1))
    assert read(stage)["inputs"]["normal"]["node"] == 0
    assert [t["name"] for t in meshes(translate(stage))["/World/Mesh"]["texcoords"]] == ["st"]
    assert not kinds(translate(stage)).keys() - {"camera"}


def test_normals_that_have_no_direction_or_tangents(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage, normal=(0.0, 0.0, 0.0))
    assert read(stage)["inputs"]["normal"]["value"] == (0, 0, 1)
    assert kinds(translate(stage))["bad normal"] == 1
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"), "st", "normal")
    texture.GetInput("st").ClearSources()
    assert read(stage)["inputs"]["normal"]["node"] == -1
    assert kinds(translate(stage))["input normal"] == 1


def test_displacement_needs_the_materials_output(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage, displacement=0.25)
    shader = surface(material)
    assert read(stage)["inputs"]["displacement"]["value"] == 0
    assert kinds(translate(stage))["input displacement"] == 1
    material.CreateDisplacementOutput().ConnectToSource(shader.ConnectableAPI(), "displacement")
    assert read(stage)["inputs"]["displacement"]["value"] == 0.25
    connect(shader, "displacement", texture_of(stage, tmp_path), "r")
    found = read(stage)["inputs"]["displacement"]
    assert (found["node"], found["channel"]) == (0, 0)
    assert "input displacement" not in kinds(translate(stage))


def test_displacement_of_another_shader(stage: Usd.Stage) -> None:
    material = square_with(stage, displacement=0.25)
    other = UsdShade.Shader.Define(stage, "/World/Material/Other")
    other.CreateIdAttr("UsdPreviewSurface")
    other.CreateInput("displacement", T.Float).Set(0.75)
    material.CreateDisplacementOutput().ConnectToSource(other.ConnectableAPI(), "displacement")
    assert read(stage)["inputs"]["displacement"]["value"] == 0.75
    other.GetIdAttr().Set("MyDisplacement")
    assert read(stage)["inputs"]["displacement"]["value"] == 0
    assert kinds(translate(stage))["shader MyDisplacement"] == 1


def test_displaced_shapes_do_not_share_and_have_the_material_themselves(stage: Usd.Stage) -> None:
    """Core displaces a mesh as its own material says, not as that of an instance."""
    plain, moved = add_material(stage, "/World/Plain"), add_material(stage, "/World/Moved", displacement=0.1)
    moved.CreateDisplacementOutput().ConnectToSource(surface(moved).ConnectableAPI(), "displacement")
    for i, material in enumerate((plain, moved, plain)):
        bind(UsdGeom.Sphere.Define(stage, f"/World/S{i}"), material)
    translation = translate(stage)
    assert translation.counts["meshes"] == 2
    found = meshes(translation)["/World/S1"]
    assert translation.scene.material(found["material"])["path"] == "/World/Moved"


def test_displacement_reaches_meshes_that_inherit_it_from_their_instance(stage: Usd.Stage) -> None:
    plain, moved = add_material(stage, "/World/Plain"), add_material(stage, "/World/Moved", displacement=0.1)
    moved.CreateDisplacementOutput().ConnectToSource(surface(moved).ConnectableAPI(), "displacement")
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Mesh")
    for i in range(2):
        prim = stage.DefinePrim(f"/World/I{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
        bind(prim, moved)
    translation = translate(stage)
    scene = translation.scene
    assert scene.material(scene.mesh(0)["material"])["path"] == "/World/Moved"
    assert "displacement of instances" not in kinds(translation)
    bind(stage.GetPrimAtPath("/World/I1"), plain)
    assert kinds(translate(stage))["displacement of instances"] == 1


def test_textured_cut_outs_are_left_to_the_renderer(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage, opacityThreshold=0.5)
    connect(surface(material), "opacity", texture_of(stage, tmp_path), "a")
    found = read(stage)
    assert found["opacity_threshold"] == 0.5
    assert (found["inputs"]["opacity"]["node"], found["inputs"]["opacity"]["channel"]) == (0, 3)
    assert "/World/Mesh" in meshes(translate(stage))


def test_a_threshold_cannot_be_textured(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage, opacityThreshold=0.25)
    connect(surface(material), "opacityThreshold", texture_of(stage, tmp_path), "r")
    assert read(stage)["opacity_threshold"] == 0.25
    assert kinds(translate(stage))["connected opacityThreshold"] == 1


def test_an_output_for_this_renderer_wins(stage: Usd.Stage) -> None:
    material = square_with(stage, roughness=0.25)
    own = UsdShade.Shader.Define(stage, "/World/Material/Own")
    own.CreateIdAttr("UsdPreviewSurface")
    own.CreateInput("roughness", T.Float).Set(0.75)
    material.CreateSurfaceOutput("encore").ConnectToSource(own.ConnectableAPI(), "surface")
    assert read(stage)["inputs"]["roughness"]["value"] == 0.75
