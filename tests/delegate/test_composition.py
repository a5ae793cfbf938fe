"""What USD composes is what is rendered: small stages in files, looked at through `encore dump`."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from encore import cli
from encore.adapters.motion import interpolate
from encore.dump import dump
from encore.errors import ExitCode, StageError
from encore.render_index import Translation
from pxr import Ar, Gf, Sdf, Ts, Usd, UsdGeom, UsdLux, UsdUtils, Vt
from stages import (
    SQUARE,
    add_material,
    add_square,
    bind,
    connect_texture,
    instances,
    kinds,
    lights,
    materials,
    meshes,
    new_stage,
    surface,
    translate,
    write_image,
)

SQUARE_TEXT = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""


def layer(folder: Path, name: str, text: str) -> str:
    """A layer of text, in which SQUARE stands for a square's attributes, and braces need no lines."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = {"{": "{\n", "}": "\n}\n"}
    text = re.sub(r"\$\{\w+\}|[{}]", lambda m: lines.get(m[0], m[0]), text.replace("SQUARE", SQUARE_TEXT))
    path.write_text("#usda 1.0\n" + text, encoding="utf-8")
    return str(path)


@pytest.fixture
def dumped(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What `encore dump` prints of a stage."""

    def run(stage: str, *flags: str) -> str:
        assert cli.main(["dump", stage, "-w", "40", *flags]) == ExitCode.OK
        return capsys.readouterr().out

    return run


def placed(text: str) -> list[str]:
    """Paths of the instances in a dump."""
    return [line.removeprefix("instance ") for line in text.splitlines() if line.startswith("instance ")]


def errors(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("report Error")]


# Arcs


def test_references_sublayers_and_what_is_stronger(tmp_path: Path, dumped: Callable[..., str]) -> None:
    layer(tmp_path, "asset.usda", '(defaultPrim = "A")\ndef Xform "A" { def Mesh "Mesh" {SQUARE} }')
    layer(tmp_path, "weak.usda", 'over "World" { over "A" { double3 xformOp:translate = (1, 1, 1) } }')
    text = dumped(
        layer(
            tmp_path,
            "root.usda",
            """(subLayers = [@weak.usda@])
            def Xform "World" {
                def "A" (references = @asset.usda@) {
                    double3 xformOp:translate = (0, 0, 7)
                    uniform token[] xformOpOrder = ["xformOp:translate"]
                }
                def "B" (references = @asset.usda@) {
                    over "Mesh" { point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)] }
                }
            }""",
        )
    )
    assert placed(text) == ["/World/A/Mesh", "/World/B/Mesh"]
    assert "to_world: (1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 7)" in text
    assert "points: (0, 0, 0, 2, 0, 0, 2, 2, 0, 0, 2, 0)" in text
    assert not errors(text)


def test_payloads_are_loaded(tmp_path: Path, dumped: Callable[..., str]) -> None:
    layer(tmp_path, "asset.usda", '(defaultPrim = "A")\ndef Xform "A" { def Mesh "Mesh" {SQUARE} }')
    root = layer(tmp_path, "root.usda", 'def Xform "World" { def "A" (payload = @asset.usda@) {} }')
    assert placed(dumped(root)) == ["/World/A/Mesh"]


def test_load_rules_of_a_stage_are_kept(tmp_path: Path) -> None:
    layer(tmp_path, "asset.usda", '(defaultPrim = "A")\ndef Xform "A" { def Mesh "Mesh" {SQUARE} }')
    root = layer(
        tmp_path,
        "root.usda",
        'def Xform "World" { def "A" (payload = @asset.usda@) {} def "B" (payload = @asset.usda@) {} }',
    )
    stage = Usd.Stage.Open(root, Usd.Stage.LoadNone)
    with pytest.raises(StageError, match="no renderable prim"):
        translate(stage)
    stage.Load("/World/B")
    assert list(instances(translate(stage))) == ["/World/B/Mesh"]
    stage.Load()
    assert list(instances(translate(stage))) == ["/World/A/Mesh", "/World/B/Mesh"]


def test_muted_layers_are_not_there(tmp_path: Path) -> None:
    weak = layer(tmp_path, "weak.usda", 'def Mesh "More" {SQUARE}')
    stage = Usd.Stage.Open(
        layer(tmp_path, "root.usda", '(subLayers = [@weak.usda@])\ndef Mesh "Mesh" {SQUARE}')
    )
    assert list(instances(translate(stage))) == ["/More", "/Mesh"]
    stage.MuteLayer(weak)
    assert list(instances(translate(stage))) == ["/Mesh"]


def test_a_population_mask(tmp_path: Path, dumped: Callable[..., str]) -> None:
    root = layer(
        tmp_path,
        "root.usda",
        """def Xform "World" {
            double3 xformOp:translate = (0, 0, 7)
            uniform token[] xformOpOrder = ["xformOp:translate"]
            def Mesh "A" {SQUARE}
            def Xform "B" { def Mesh "C" {SQUARE} def Mesh "D" {SQUARE} }
            def Mesh "E" {SQUARE}
            def SphereLight "Light" {}
        }""",
    )
    assert placed(dumped(root, "--mask", "/World/B")) == ["/World/B/C", "/World/B/D"]
    text = dumped(root, "--mask", "/World/B/D,/World/E,/World/Light")
    assert placed(text) == ["/World/B/D", "/World/E"]
    assert "light /World/Light" in text
    assert "to_world: (1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 7)" in text, "ancestors still transform"


def test_a_session_layer_is_the_strongest(tmp_path: Path, dumped: Callable[..., str]) -> None:
    root = layer(tmp_path, "root.usda", 'def Mesh "Mesh" { SQUARE }\ndef Mesh "Other" {SQUARE}')
    session = layer(
        tmp_path, "session.usda", 'over "Mesh" (active = false) {}\nover "Other" { bool doubleSided = 1 }'
    )
    assert placed(dumped(root)) == ["/Mesh", "/Other"]
    text = dumped(root, "--sessionLayer", session)
    assert placed(text) == ["/Other"] and "double_sided: True" in text


VARIANTS = """(defaultPrim = "A")
def Xform "A" (
    variants = { string size = "small" }
    prepend variantSets = ["size", "look"]
) {
    variantSet "size" = {
        "small" { def Mesh "Mesh" {SQUARE} }
        "large" (variants = { string look = "red" }) { def Mesh "Mesh" {SQUARE bool doubleSided = 1} }
    }
    variantSet "look" = { "red" { over "Mesh" { color3f[] primvars:displayColor = [(1, 0, 0)] } } }
}"""


def test_variants(tmp_path: Path, dumped: Callable[..., str]) -> None:
    layer(tmp_path, "asset.usda", VARIANTS)
    root = layer(
        tmp_path,
        "root.usda",
        """def Xform "World" {
            def "A" (references = @asset.usda@) {}
            def "B" (references = @asset.usda@
                     variants = { string size = "large" }) {}
        }""",
    )
    text = dumped(root)
    first, second = text.split("mesh /World/A/Mesh")[1].split("mesh /World/B/Mesh")
    assert "double_sided: False" in first and "material: default" in first
    assert "double_sided: True" in second and "material: displayColor(1, 0, 0)" in second
    session = layer(
        tmp_path,
        "session.usda",
        'over "World" { over "A" (variants = { string size = "large"; string look = "red" }) {} }',
    )
    assert "double_sided: False" not in dumped(root, "--sessionLayer", session)


def test_inherits_and_specializes(tmp_path: Path, dumped: Callable[..., str]) -> None:
    """An inherited class is stronger than what a reference brings; a specialized one is weaker."""
    layer(tmp_path, "asset.usda", '(defaultPrim = "A")\ndef Mesh "A" {SQUARE bool doubleSided = 0}')
    root = layer(
        tmp_path,
        "root.usda",
        """class "_class" { bool doubleSided = 1 }
        def Mesh "Inherits" (references = @asset.usda@
                             inherits = </_class>) {}
        def Mesh "Specializes" (references = @asset.usda@
                                specializes = </_class>) {}""",
    )
    text = dumped(root)
    assert placed(text) == ["/Inherits", "/Specializes"], "the class itself is not rendered"
    first, second = text.split("mesh /Inherits")[1].split("mesh /Specializes")
    assert "double_sided: True" in first and "double_sided: False" in second


def test_relocates(tmp_path: Path, dumped: Callable[..., str]) -> None:
    layer(
        tmp_path,
        "asset.usda",
        '(defaultPrim = "A")\ndef Xform "A" { def Xform "B" { def Mesh "M" {SQUARE} } }',
    )
    root = layer(
        tmp_path,
        "root.usda",
        """(relocates = { </World/A/B/M> : </World/A/Moved> })
        def Xform "World" { def "A" (references = @asset.usda@) {
            over "B" {
                double3 xformOp:translate = (0, 0, 7)
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }
        } }""",
    )
    text = dumped(root)
    assert placed(text) == ["/World/A/Moved"]
    assert "to_world: (1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0)" in text, "B is no longer its parent"


def test_layers_by_expression_variables(tmp_path: Path, dumped: Callable[..., str]) -> None:
    layer(tmp_path, "red.usda", '(defaultPrim = "A")\ndef Mesh "A" {SQUARE}')
    layer(tmp_path, "blue.usda", '(defaultPrim = "A")\ndef Mesh "A" {SQUARE bool doubleSided = 1}')
    root = layer(
        tmp_path,
        "root.usda",
        """(expressionVariables = { string NAME = "red" })
        def "A" (references = @`"${NAME}.usda"`@) {}""",
    )
    assert "double_sided: False" in dumped(root)
    session = layer(tmp_path, "session.usda", '(expressionVariables = { string NAME = "blue" })')
    assert "double_sided: True" in dumped(root, "--sessionLayer", session)


def test_what_is_not_defined_is_not_rendered(tmp_path: Path, dumped: Callable[..., str]) -> None:
    root = layer(
        tmp_path,
        "root.usda",
        """def Mesh "Mesh" {SQUARE}
        class Mesh "Class" {SQUARE}
        over Mesh "Over" {SQUARE}
        def Mesh "Inactive" (active = false) {SQUARE}
        def Xform "Group" {
            over "Over" { def Mesh "Inside" {SQUARE} }
            class "C" { def Mesh "Inside" {SQUARE} }
        }""",
    )
    assert placed(dumped(root)) == ["/Mesh"]


# What of the stage matters, and what does not


def test_purposes_and_visibility(tmp_path: Path, dumped: Callable[..., str]) -> None:
    root = layer(
        tmp_path,
        "root.usda",
        """def Mesh "Default" {SQUARE}
        def Mesh "Render" {SQUARE uniform token purpose = "render"}
        def Xform "Group" { uniform token purpose = "proxy"
            def Mesh "Proxy" {SQUARE} }
        def Mesh "Guide" {SQUARE uniform token purpose = "guide"}
        def Xform "Hidden" { token visibility = "invisible"
            def Mesh "Mesh" {SQUARE token visibility = "inherited"} }""",
    )
    assert placed(dumped(root)) == ["/Default", "/Group/Proxy"], "usdrecord's purposes"
    assert placed(dumped(root, "--purposes", "render")) == ["/Default", "/Render"]
    assert placed(dumped(root, "--purposes", "guide,render")) == ["/Default", "/Render", "/Guide"]


@pytest.mark.parametrize("kind", ["component", "group", "assembly", "subcomponent", "nonsense"])
def test_model_kinds_change_nothing(stage: Usd.Stage, kind: str) -> None:
    add_square(stage, "/World/Mesh")
    expected = dump(translate(stage))
    Usd.ModelAPI(stage.GetPrimAtPath("/World")).SetKind(kind)
    Usd.ModelAPI(stage.GetPrimAtPath("/World/Mesh")).SetKind(kind)
    assert dump(translate(stage)) == expected


def test_units_do_not_scale_anything(stage: Usd.Stage) -> None:
    """World space is the stage's own; so are the units of cameras and lights."""
    add_square(stage, "/World/Mesh")
    UsdGeom.Camera.Define(stage, "/World/Camera")
    UsdLux.SphereLight.Define(stage, "/World/Light")
    expected = dump(translate(stage))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    assert dump(translate(stage)) == expected


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_the_up_axis(tmp_path: Path, dumped: Callable[..., str], axis: str) -> None:
    root = layer(
        tmp_path, "root.usda", f'(upAxis = "{axis}")\ndef Mesh "Mesh" {{SQUARE}}\ndef DomeLight "Sky" {{}}'
    )
    text = dumped(root)
    (view,) = [line for line in text.splitlines() if line.startswith("  to_world")][:1]
    numbers = [float(n) for n in view.partition("(")[2].rstrip(")").split(", ")]
    assert numbers[4:7] == pytest.approx([0, 1, 0] if axis == "Y" else [0, 0, 1]), "the picture's up"
    assert "axis_y: (0, 1, 0)" in text, "a DomeLight's pole is Y whatever the stage says"


# Packages and resolvers


def add_picture(stage: Usd.Stage, folder: Path, name: str = "wood.png") -> None:
    """A square with a texture beside its layer."""
    (folder / "textures").mkdir(exist_ok=True)
    write_image(folder / "textures" / name, np.ones((2, 4, 3)))
    material = add_material(stage, "/World/Material")
    connect_texture(stage, surface(material), f"./textures/{name}")
    mesh = add_square(stage, "/World/Mesh")
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [(0, 0), (1, 0), (1, 1), (0, 1)]
    )
    bind(mesh, material)


def test_a_package_with_its_textures(tmp_path: Path, dumped: Callable[..., str]) -> None:
    (tmp_path / "made").mkdir()
    stage = Usd.Stage.CreateNew(str(tmp_path / "made" / "root.usda"))
    add_picture(stage, tmp_path / "made")
    stage.Save()
    package = str(tmp_path / "a.usdz")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "made" / "root.usda"), package)
    (tmp_path / "made").rename(tmp_path / "gone")
    text = dumped(package, "--strict")
    assert f"texture {package}[" in text and "wood.png]\n  size: 4 x 2" in text
    root = layer(tmp_path, "root.usda", 'def "Prop" (references = @a.usdz@</World>) {}')
    assert f"texture {package}[" in dumped(root, "--strict"), "referenced as well"


def test_textures_by_the_search_path_of_the_context(tmp_path: Path) -> None:
    (tmp_path / "library").mkdir()
    write_image(tmp_path / "library" / "wood.png", np.ones((2, 4, 3)))
    write_image(tmp_path / "library" / "tile.1001.png", np.ones((3, 5, 3)))
    layer(tmp_path / "library", "asset.usda", '(defaultPrim = "A")\ndef Mesh "A" {SQUARE}')
    root = layer(tmp_path / "shot", "root.usda", 'def "World" { def "Asset" (references = @asset.usda@) {} }')
    context = Ar.ResolverContext(Ar.DefaultResolverContext([str(tmp_path / "library")]))
    stage = Usd.Stage.Open(root, context)
    for name, file in (("Plain", "wood.png"), ("Tiles", "tile.<UDIM>.png")):
        material = add_material(stage, f"/World/{name}")
        connect_texture(stage, surface(material), file)
        mesh = add_square(stage, f"/World/{name}Mesh")
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "constant").Set(
            [(0, 0)]
        )
        bind(mesh, material)
    text = dump(translate(stage))
    assert not errors(text), errors(text)
    assert f"texture {tmp_path / 'library' / 'wood.png'}\n  size: 4 x 2" in text
    assert f"texture {tmp_path / 'library' / 'tile.1001.png'}\n  size: 5 x 3" in text


def test_the_default_search_path_of_the_environment(tmp_path: Path) -> None:
    layer(tmp_path / "library", "asset.usda", '(defaultPrim = "A")\ndef Mesh "A" {SQUARE}')
    root = layer(tmp_path / "shot", "root.usda", 'def "Asset" (references = @asset.usda@) {}')
    found = subprocess.run(
        [sys.executable, "-m", "encore", "dump", root, "--strict"],
        env={**os.environ, "PXR_AR_DEFAULT_SEARCH_PATH": str(tmp_path / "library")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert placed(found.stdout) == ["/Asset"]


# Time


def at(stage: Usd.Stage, time: float) -> Translation:
    return translate(stage, time=Usd.TimeCode(time))


MOVING = """(defaultPrim = "A"; timeCodesPerSecond = 24; startTimeCode = 0; endTimeCode = 10)
def Xform "A" {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (10, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "Mesh" {SQUARE
        point3f[] points.timeSamples = {
            0: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
            10: [(0, 0, 10), (1, 0, 10), (1, 1, 10), (0, 1, 10)] }
    }
}"""


@pytest.mark.parametrize(
    ("arc", "rate", "to_asset"),
    [
        ("references = @asset.usda@ (offset = 4)", 24, lambda t: t - 4),
        ("references = @asset.usda@ (offset = 4; scale = 2)", 24, lambda t: (t - 4) / 2),
        ("references = @asset.usda@", 48, lambda t: t / 2),
        ("references = @asset.usda@ (offset = 6; scale = 0.5)", 12, lambda t: 2 * (2 * t - 12)),
        ("payload = @asset.usda@ (offset = 4)", 24, lambda t: t - 4),
    ],
)
def test_layer_offsets_and_rates_of_time_codes(
    tmp_path: Path, arc: str, rate: float, to_asset: Callable[[float], float]
) -> None:
    """Values and motion at the asset's own time."""
    layer(tmp_path, "asset.usda", MOVING)
    stage = Usd.Stage.Open(
        layer(
            tmp_path,
            "root.usda",
            f"""(timeCodesPerSecond = {rate})
            def "A" ({arc}) {{}}
            def Camera "Camera" {{ double shutter:open = -0.25
                double shutter:close = 0.25 }}""",
        )
    )
    probe = stage.GetPrimAtPath("/A").GetAttribute("xformOp:translate")
    time = next(t for t in np.linspace(0, 30, 301) if probe.Get(t)[0] == pytest.approx(3, abs=0.4))
    asset = to_asset(float(time))
    assert probe.Get(float(time))[0] == pytest.approx(asset)
    found = at(stage, float(time))
    (matrix,), (mesh,) = instances(found).values(), meshes(found).values()
    assert matrix["to_world"][3, 0] == pytest.approx(asset)
    assert mesh["points"][0, 2] == pytest.approx(asset, abs=1e-5)
    speed = to_asset(1.0) - to_asset(0.0)
    np.testing.assert_allclose(
        np.array(matrix["motion"])[[0, -1], 3, 0], asset + 0.25 * speed * np.array([-1, 1]), atol=1e-9
    )
    keys = np.array(mesh["motion_points"])
    np.testing.assert_allclose(keys[[0, -1], 0, 2], asset + 0.25 * speed * np.array([-1, 1]), atol=1e-5)


def test_sublayers_have_offsets_too(tmp_path: Path, dumped: Callable[..., str]) -> None:
    layer(tmp_path, "asset.usda", MOVING)
    root = layer(tmp_path, "root.usda", "(subLayers = [@asset.usda@ (offset = 2; scale = 3)])")
    assert "to_world: (1, 0, 0, 0, 1, 0, 0, 0, 1, 4, 0, 0)" in dumped(root, "-f", "14")


CLIP = """(startTimeCode = {start}; endTimeCode = {end})
def "A" {{ def "Mesh" {{
    point3f[] points.timeSamples = {{
        {start}: [(0, 0, {start}), (1, 0, {start}), (1, 1, {start}), (0, 1, {start})],
        {end}: [(0, 0, {end}), (1, 0, {end}), (1, 1, {end}), (0, 1, {end})] }}
}} }}"""
EXPLICIT = """
    asset[] assetPaths = [@clip.1.usda@, @clip.2.usda@]
    asset manifestAssetPath = @manifest.usda@
    string primPath = "/A"
    double2[] active = [(0, 0), (10, 1)]
    double2[] times = [(0, 0), (10, 10), (10, 10), (20, 20)]
"""
TEMPLATE = """
    asset manifestAssetPath = @manifest.usda@
    string primPath = "/A"
    string templateAssetPath = "clip.#.usda"
    double templateStartTime = 1
    double templateEndTime = 2
    double templateStride = 1
"""


@pytest.mark.parametrize("form", ["explicit", "template"])
def test_value_clips(tmp_path: Path, form: str) -> None:
    """Points come from one file per stretch of time, with the motion between their samples."""
    spans = [(0, 10), (10, 20)] if form == "explicit" else [(1, 2), (2, 3)]
    for i, (start, end) in enumerate(spans):
        layer(tmp_path, f"clip.{i + 1}.usda", CLIP.format(start=start, end=end))
    layer(tmp_path, "manifest.usda", 'def "A" { def "Mesh" { point3f[] points } }')
    clips = EXPLICIT if form == "explicit" else TEMPLATE
    stage = Usd.Stage.Open(
        layer(
            tmp_path,
            "root.usda",
            f"""(endTimeCode = 20)
            def Xform "Model" (clips = {{ dictionary default = {{ {clips} }} }}) {{
                def Mesh "Mesh" {{
                    int[] faceVertexCounts = [4]
                    int[] faceVertexIndices = [0, 1, 2, 3]
                    uniform token subdivisionScheme = "none"
                }}
            }}
            def Camera "Camera" {{ double shutter:open = -0.25
                double shutter:close = 0.25 }}""",
        )
    )
    for time in (1.25, 1.5, 1.75) if form == "template" else (4.0, 9.875, 10.0, 14.5):
        found = meshes(at(stage, time))["/Model/Mesh"]
        attribute = stage.GetPrimAtPath("/Model/Mesh").GetAttribute("points")
        for fraction in (0.0, 0.3, 1.0):
            truth = np.array(attribute.Get(time - 0.25 + 0.5 * fraction))
            keys = np.array(found["motion_points"])
            np.testing.assert_allclose(interpolate(keys, np.array([fraction]))[0], truth, atol=1e-3)
        np.testing.assert_array_equal(found["points"], attribute.Get(time))
        assert found["points"][0, 2] == pytest.approx(time)


def test_values_are_held_where_the_stage_says_so(stage: Usd.Stage) -> None:
    op = add_square(stage, "/World/Mesh").AddTranslateOp()
    for frame in (1, 2):
        op.Set((frame, 0, 0), frame)
    stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    assert instances(at(stage, 1.75))["/World/Mesh"]["to_world"][3, 0] == 1


def _set(attribute: Usd.Attribute, value: Any, time: Any) -> None:
    attribute.Set(value, time)


def _translate(xformable: UsdGeom.Xformable) -> Usd.Attribute:
    """The attribute of its one op."""
    ops = xformable.GetOrderedXformOps()
    return (ops[0] if ops else xformable.AddTranslateOp()).GetAttr()


def animated_topology(stage: Usd.Stage, frame: float, time: Any) -> None:
    """A fan of as many triangles as the frame says, with a colour each."""
    mesh = UsdGeom.Mesh.Define(stage, "/World/Mesh")
    mesh.CreateSubdivisionSchemeAttr("none")
    count = int(frame) + 1
    points = [(0, 0, 0), *((np.cos(i), np.sin(i), 0) for i in range(count + 1))]
    _set(mesh.CreatePointsAttr(), Vt.Vec3fArray(points), time)
    _set(mesh.CreateFaceVertexCountsAttr(), [3] * count, time)
    _set(mesh.CreateFaceVertexIndicesAttr(), [j for i in range(count) for j in (0, i + 1, i + 2)], time)
    color = mesh.CreateDisplayColorPrimvar("uniform")
    _set(color.GetAttr(), [(frame / 10, i / 10, 0) for i in range(count)], time)
    _set(mesh.CreateNormalsAttr(), [(0, 0, 1)] * (count + 2), time)


def animated_subdivision(stage: Usd.Stage, frame: float, time: Any) -> None:
    mesh = UsdGeom.Mesh.Define(stage, "/World/Mesh")
    mesh.CreatePointsAttr(SQUARE)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    _set(mesh.CreateCreaseIndicesAttr(), [0, 1] if frame < 2 else [1, 2], time)
    _set(mesh.CreateCreaseLengthsAttr(), [2], time)
    _set(mesh.CreateCreaseSharpnessesAttr(), [frame], time)
    _set(mesh.CreateCornerIndicesAttr(), [int(frame)], time)
    _set(mesh.CreateCornerSharpnessesAttr(), [frame], time)


def animated_primvars(stage: Usd.Stage, frame: float, time: Any) -> None:
    mesh = add_square(stage, "/World/Mesh")
    primvar = mesh.CreateDisplayColorPrimvar("vertex")
    _set(primvar.GetAttr(), [(frame / 10, 0, 0), (0, frame / 10, 0)], time)
    _set(primvar.CreateIndicesAttr(), [0, 1, 1, 0] if frame < 2 else [1, 1, 0, 0], time)


def animated_visibility(stage: Usd.Stage, frame: float, time: Any) -> None:
    add_square(stage, "/World/Other")
    mesh = add_square(stage, "/World/Mesh")
    _set(mesh.CreateVisibilityAttr(), "inherited" if frame < 3 else "invisible", time)
    group = UsdGeom.Xform.Define(stage, "/World/Group")
    add_square(stage, "/World/Group/Mesh")
    _set(group.CreateVisibilityAttr(), "invisible" if frame < 2 else "inherited", time)


def animated_material(stage: Usd.Stage, frame: float, time: Any) -> None:
    material = add_material(stage, "/World/Material", roughness=0.5, diffuseColor=(0.5, 0.5, 0.5))
    bind(add_square(stage, "/World/Mesh"), material)
    shader = surface(material)
    _set(shader.GetInput("roughness").GetAttr(), frame / 10, time)
    public = material.CreateInput("tint", Sdf.ValueTypeNames.Color3f)
    _set(public.GetAttr(), (frame / 10, 0.1, 0.2), time)
    shader.GetInput("diffuseColor").ConnectToSource(public)


def animated_lights(stage: Usd.Stage, frame: float, time: Any) -> None:
    add_square(stage, "/World/Mesh")
    light = UsdLux.RectLight.Define(stage, "/World/Rect")
    _set(light.CreateIntensityAttr(), frame, time)
    _set(light.CreateColorAttr(), (frame / 10, 0.5, 1), time)
    _set(light.CreateWidthAttr(), frame, time)
    _set(_translate(light), (frame, 0, 5), time)
    sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
    _set(sun.CreateAngleAttr(), frame, time)
    _set(sun.CreateExposureAttr(), frame, time)
    _set(UsdLux.ShadowAPI.Apply(sun.GetPrim()).CreateShadowDistanceAttr(), frame, time)


def animated_camera(stage: Usd.Stage, frame: float, time: Any) -> None:
    add_square(stage, "/World/Mesh")
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    _set(_translate(camera), (0, frame, 5), time)
    _set(camera.CreateFocalLengthAttr(), 30 + frame, time)
    _set(camera.CreateHorizontalApertureAttr(), 20 + frame, time)
    _set(camera.CreateClippingRangeAttr(), (1 + frame, 1000), time)
    _set(camera.CreateFStopAttr(), frame, time)
    _set(camera.CreateFocusDistanceAttr(), frame, time)


def animated_shapes(stage: Usd.Stage, frame: float, time: Any) -> None:
    _set(UsdGeom.Sphere.Define(stage, "/World/Sphere").CreateRadiusAttr(), frame, time)
    _set(UsdGeom.Cube.Define(stage, "/World/Cube").CreateSizeAttr(), frame, time)
    cone = UsdGeom.Cone.Define(stage, "/World/Cone")
    _set(cone.CreateHeightAttr(), frame, time)


def animated_instancer(stage: Usd.Stage, frame: float, time: Any) -> None:
    add_square(stage, "/World/Instancer/A")
    UsdGeom.Sphere.Define(stage, "/World/Instancer/B")
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Instancer")
    instancer.CreatePrototypesRel().SetTargets(["/World/Instancer/A", "/World/Instancer/B"])
    count = int(frame) + 1
    _set(instancer.CreateProtoIndicesAttr(), [i % 2 for i in range(count)], time)
    _set(instancer.CreatePositionsAttr(), Vt.Vec3fArray([(i, frame, 0) for i in range(count)]), time)
    _set(instancer.CreateScalesAttr(), Vt.Vec3fArray([(1, 1, frame)] * count), time)
    _set(instancer.CreateInvisibleIdsAttr(), Vt.Int64Array([0] if frame == 2 else []), time)


def animated_curves(stage: Usd.Stage, frame: float, time: Any) -> None:
    curves = UsdGeom.BasisCurves.Define(stage, "/World/Curves")
    curves.CreateTypeAttr("linear")
    count = int(frame) + 1
    _set(curves.CreatePointsAttr(), Vt.Vec3fArray([(i, frame, 0) for i in range(2 * count)]), time)
    _set(curves.CreateCurveVertexCountsAttr(), [2] * count, time)
    _set(curves.CreateWidthsAttr(), [frame / 10] * (2 * count), time)


def animated_points(stage: Usd.Stage, frame: float, time: Any) -> None:
    points = UsdGeom.Points.Define(stage, "/World/Points")
    count = int(frame) + 1
    _set(points.CreatePointsAttr(), Vt.Vec3fArray([(i, frame, 0) for i in range(count)]), time)
    _set(points.CreateWidthsAttr(), [frame / 10] * count, time)


def animated_subset(stage: Usd.Stage, frame: float, time: Any) -> None:
    mesh = add_square(stage, "/World/Mesh")
    mesh.GetFaceVertexCountsAttr().Set([3, 3])
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 0, 2, 3])
    subset = UsdGeom.Subset.Define(stage, "/World/Mesh/Subset")
    subset.CreateElementTypeAttr("face")
    subset.CreateFamilyNameAttr("materialBind")
    bind(subset, add_material(stage, "/World/Material"))
    _set(subset.CreateIndicesAttr(), [[0], [1], [0, 1]][int(frame) - 1], time)


EVERYTHING = (
    animated_topology,
    animated_subdivision,
    animated_primvars,
    animated_visibility,
    animated_material,
    animated_lights,
    animated_camera,
    animated_shapes,
    animated_instancer,
    animated_curves,
    animated_points,
    animated_subset,
)


@pytest.mark.parametrize("animate", EVERYTHING, ids=lambda f: f.__name__)
def test_time_samples_of_everything(animate: Callable[[Usd.Stage, float, Any], None]) -> None:
    """A frame of an animated stage is that of a still one with the values of that frame."""
    frames = (1.0, 2.0, 3.0)
    animated = new_stage()
    for frame in frames:
        animate(animated, frame, Usd.TimeCode(frame))
    texts = []
    for frame in frames:
        still = new_stage()
        animate(still, frame, Usd.TimeCode.Default())
        text = dump(at(animated, frame))
        assert text == dump(translate(still))
        texts.append(text)
    assert len(set(texts)) == len(frames)


def spline(*knots: tuple[float, float]) -> Ts.Spline:
    """Linear between knots (time, value)."""
    made = Ts.Spline()
    for time, value in knots:
        made.SetKnot(Ts.Knot(typeName="double", time=time, value=value, nextInterp=Ts.InterpLinear))
    return made


def test_splines(stage: Usd.Stage) -> None:
    stage.SetEndTimeCode(5)
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    assert ball.CreateRadiusAttr().SetSpline(spline((0, 1), (4, 3)))
    mesh = add_square(stage, "/World/Mesh")
    assert (
        mesh.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble)
        .GetAttr()
        .SetSpline(spline((0, 0), (1, 30), (4, 90)))
    )
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateShutterOpenAttr(-1.0)
    camera.CreateShutterCloseAttr(1.0)
    found = instances(at(stage, 2))
    assert found["/World/Ball"]["to_world"][0, 0] == pytest.approx(2)
    xformable = UsdGeom.Xformable(mesh)
    keys = np.array(found["/World/Mesh"]["motion"])
    for fraction in np.linspace(0, 1, 17):
        truth = np.array(xformable.GetLocalTransformation(Usd.TimeCode(1 + 2 * fraction)))
        np.testing.assert_allclose(interpolate(keys, np.array([fraction]))[0], truth, atol=1e-3)


def test_blocked_samples_are_as_not_authored(stage: Usd.Stage) -> None:
    """A block at a sample hides the value until the next one."""
    add_square(stage, "/World/Other")
    mesh = add_square(stage, "/World/Mesh")
    mesh.GetDoubleSidedAttr().Set(True)
    color = mesh.CreateDisplayColorPrimvar("constant")
    color.Set([(1, 0, 0)], 1)
    color.GetAttr().Set(Sdf.ValueBlock(), 2)
    color.Set([(0, 1, 0)], 3)
    mesh.GetPointsAttr().Clear()
    mesh.GetPointsAttr().Set(SQUARE, 1)
    mesh.GetPointsAttr().Set(Sdf.ValueBlock(), 4)
    names = [{m["path"] for m in materials(at(stage, t)).values()} for t in (1, 2.5, 3)]
    assert "displayColor(1, 0, 0)" in names[0]
    assert not any(n.startswith("displayColor(") for n in names[1])
    assert "displayColor(0, 1, 0)" in names[2]
    hidden = at(stage, 4.5)
    assert list(instances(hidden)) == ["/World/Other"] and kinds(hidden)["empty mesh"] == 1
    assert lights(hidden) == {}
    assert Gf.Vec3f(*meshes(at(stage, 3.5))["/World/Mesh"]["points"][2].tolist()) == Gf.Vec3f(1, 1, 0)
