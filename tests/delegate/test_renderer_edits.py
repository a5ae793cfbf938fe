"""Edit and render again: bit for bit what a new Renderer makes of the edited stage."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from encore.errors import StageError
from encore.renderer import Renderer
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from stages import (
    add_instance,
    add_material,
    add_point_instancer,
    add_square,
    bind,
    connect_texture,
    surface,
    write_image,
)
from test_renderer import QUICK, equal, new_scene

pytest.importorskip("encore._core")

# What it returns is of no interest.
Edit = Callable[[Usd.Stage], object]
AOVS = ("color", "depth", "normal")
SMALL = {**QUICK, "width": 32, "height": 24}


def new_world(folder: Path) -> Usd.Stage:
    """A stage with one of everything that is edited below, in view of /Camera."""
    stage = new_scene()
    stage.SetEndTimeCode(2)
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    UsdGeom.XformCommonAPI(ball).SetTranslate((4, 4, -12))
    ball.CreateDisplayColorAttr([(0.2, 0.7, 0.3)])
    lump = UsdGeom.Mesh.Define(stage, "/World/Lump")
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    lump.CreatePointsAttr(corners)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lump.CreateFaceVertexCountsAttr([4] * 6)
    lump.CreateFaceVertexIndicesAttr([i for face in faces for i in face])
    UsdGeom.PrimvarsAPI(lump).CreatePrimvar(
        "encore:targetEdgeLength", Sdf.ValueTypeNames.Float, "constant"
    ).Set(0.5)
    UsdGeom.XformCommonAPI(lump).SetTranslate((-3, -4, -12))
    mirror = add_material(stage, "/World/Mirror", metallic=1.0, roughness=0.1, diffuseColor=(0.9, 0.8, 0.7))
    bind(lump, mirror)
    # Two native instances of one asset.
    asset = stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Square")
    for i in range(2):
        prim = add_instance(stage, f"/World/Copy{i}", asset.GetPath())
        UsdGeom.XformCommonAPI(prim).SetTranslate((2 + 1.5 * i, -5, -9))
    # A PointInstancer, textured.
    instancer = add_point_instancer(stage, "/World/Dots", ["/World/Dots/Dot"], [0, 0, 0])
    dot = add_square(stage, "/World/Dots/Dot")
    UsdGeom.XformCommonAPI(dot).SetScale((0.8, 0.8, 0.8))
    coordinates = UsdGeom.PrimvarsAPI(dot).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    coordinates.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    instancer.GetPositionsAttr().Set([(1, 1, -8), (2, 1, -8), (3, 2, -8)])
    wood = add_material(stage, "/World/Wood", roughness=0.9)
    random = np.random.default_rng(2)
    for name in "ab":
        write_image(folder / f"{name}.png", random.random((8, 8, 3)))
    connect_texture(stage, surface(wood), str(folder / "a.png"))
    bind(instancer, wood)
    # A variant set.
    choice = stage.DefinePrim("/World/Choice", "Xform")
    UsdGeom.XformCommonAPI(choice).SetTranslate((-6, -5, -11))
    variants = choice.GetVariantSets().AddVariantSet("shape")
    for kind in ("Cube", "Cone"):
        variants.AddVariant(kind)
        variants.SetVariantSelection(kind)
        with variants.GetVariantEditContext():
            stage.DefinePrim("/World/Choice/It", kind)
    variants.SetVariantSelection("Cube")
    lamp = UsdLux.SphereLight.Define(stage, "/World/Lamp")
    lamp.CreateIntensityAttr(30)
    UsdGeom.XformCommonAPI(lamp).SetTranslate((0, 5, -6))
    # What moves with time.
    UsdGeom.XformCommonAPI(ball).SetRotate((0, 0, 0), time=1)
    translate = UsdGeom.XformCommonAPI(stage.DefinePrim("/World/Moving", "Cylinder"))
    translate.SetScale((0.5, 0.5, 0.5))
    for time, x in ((1, 5.0), (2, 6.0)):
        translate.SetTranslate((x, -3, -10), time)
    return stage


def attribute(stage: Usd.Stage, path: str) -> Usd.Attribute:
    return stage.GetAttributeAtPath(path)


def _set(path: str, value: Any) -> Edit:
    return lambda stage: attribute(stage, path).Set(value)


def _rotate(path: str, degrees: float) -> Edit:
    return lambda stage: UsdGeom.XformCommonAPI(stage.GetPrimAtPath(path)).SetRotate((0, 0, degrees))


def _rebind(path: str, material: str) -> Edit:
    def edit(stage: Usd.Stage) -> None:
        bind(stage.GetPrimAtPath(path), UsdShade.Material.Get(stage, material))

    return edit


def _add_ball(stage: Usd.Stage) -> None:
    ball = UsdGeom.Sphere.Define(stage, "/World/Another")
    UsdGeom.XformCommonAPI(ball).SetTranslate((-7, 1, -9))


def _rename(stage: Usd.Stage) -> None:
    editor = Usd.NamespaceEditor(stage)
    assert editor.MovePrimAtPath("/World/Lump", "/World/Renamed")
    assert editor.ApplyEdits()


def _own_color(stage: Usd.Stage) -> None:
    UsdGeom.Gprim(stage.GetPrimAtPath("/World/Card")).CreateDisplayColorAttr([(0, 0, 1)])
    UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/Card")).UnbindAllBindings()


_KEPT: list[Sdf.Layer] = []


def _stronger_layer(stage: Usd.Stage) -> None:
    layer = Sdf.Layer.CreateAnonymous()
    over = Sdf.CreatePrimInLayer(layer, "/World/Ball")
    over.specifier = Sdf.SpecifierOver
    Sdf.AttributeSpec(over, "radius", Sdf.ValueTypeNames.Double).default = 1.7
    stage.GetSessionLayer().subLayerPaths.append(layer.identifier)
    _KEPT.append(layer)


def _many_at_once(stage: Usd.Stage) -> None:
    with Sdf.ChangeBlock():
        attribute(stage, "/World/Ball.primvars:displayColor").Set([(0.9, 0.1, 0.9)])
        attribute(stage, "/World/Lamp.inputs:intensity").Set(60.0)
        attribute(stage, "/World/Dots.protoIndices").Set([0, 0])
        attribute(stage, "/World/Dots.positions").Set([(1, 3, -8), (2, 3, -8)])


def _link(stage: Usd.Stage) -> None:
    links = UsdLux.LightAPI(stage.GetPrimAtPath("/World/Lamp")).GetLightLinkCollectionAPI()
    links.ExcludePath("/World/Card")


CAMERA = "/Camera.focalLength"
EDITS: dict[str, Edit] = {
    "a material's colour": _set("/World/Red/Surface.inputs:diffuseColor", (0.1, 0.2, 0.9)),
    "a material becomes transparent": _set("/World/Mirror/Surface.inputs:metallic", 0.3),
    "a texture's file": lambda stage: None,  # below: it needs the folder
    "another material": _rebind("/World/Lump", "/World/Red"),
    "no material": _own_color,
    "points": _set("/World/Card.points", [(-10, 0, -10), (1, 0, -11), (0, 9, -10), (-10, 10, -10)]),
    "topology": lambda stage: (
        (
            attribute(stage, "/World/Card.faceVertexCounts").Set([3]),
            attribute(stage, "/World/Card.faceVertexIndices").Set([0, 1, 2]),
        )
    ),
    "a subdivision scheme": _set("/World/Lump.subdivisionScheme", "bilinear"),
    "a radius": _set("/World/Ball.radius", 1.4),
    "a transform": _rotate("/World/Lump", 30),
    "the transform above everything": _rotate("/World", 5),
    "an inherited edge length": lambda stage: (
        UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Lump")).GetPrimvar("encore:targetEdgeLength").Set(0.2)
    ),
    "displayColor": _set("/World/Ball.primvars:displayColor", [(1, 1, 0)]),
    "visibility": lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath("/World/Ball")).MakeInvisible(),
    "purpose": lambda stage: (
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/Ball")).CreatePurposeAttr("guide").Set("guide")
    ),
    "a prim that is not active": lambda stage: stage.GetPrimAtPath("/World/Copy0").SetActive(False),
    "a new prim": _add_ball,
    "a prim that is gone": lambda stage: stage.RemovePrim("/World/Lump"),
    "a prim of another name": _rename,
    "an instance's transform": _rotate("/World/Copy1", 45),
    "what is instanced": _set("/Asset/Square.points", [(0, 0, 0), (1, 0, 0.5), (1, 1, 0), (0, 1, 0)]),
    "an instance that is none any more": lambda stage: stage.GetPrimAtPath("/World/Copy0").SetInstanceable(
        False
    ),
    "positions of instances": _set("/World/Dots.positions", [(0, 3, -8), (1, 2, -8), (2, 1, -8)]),
    "ids of instances": _set("/World/Dots.invisibleIds", [1]),
    "a variant": lambda stage: (
        stage.GetPrimAtPath("/World/Choice").GetVariantSet("shape").SetVariantSelection("Cone")
    ),
    "a layer": _stronger_layer,
    "a light's intensity": _set("/World/Lamp.inputs:intensity", 90.0),
    "a light's place": lambda stage: UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/World/Lamp")).SetTranslate(
        (3, 5, -6)
    ),
    "a light that is gone": lambda stage: stage.RemovePrim("/World/Sky"),
    "light linking": _link,
    "the camera's lens": _set(CAMERA, 25.0),
    "the camera's place": lambda stage: UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/Camera")).SetTranslate(
        (0.5, 0, 2)
    ),
    "many things at once": _many_at_once,
}

# Edits that change prims, and no pixel.
UNSEEN = ("a prim of another name", "an instance that is none any more")


@pytest.fixture
def renderer(tmp_path: Path) -> Iterator[Renderer]:
    EDITS["a texture's file"] = lambda stage: attribute(
        stage, "/World/Wood/Surface_diffuseColor.inputs:file"
    ).Set(str(tmp_path / "b.png"))
    with Renderer(new_world(tmp_path), **SMALL) as made:
        yield made


def fresh(renderer: Renderer, time: float | None = None) -> Any:
    """What a new Renderer makes of the stage as it is."""
    with Renderer(renderer.stage, **SMALL) as other:
        return other.render(time, AOVS)


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_rendered_as_by_a_new_renderer(renderer: Renderer, name: str) -> None:
    before = renderer.render(aovs=AOVS)
    EDITS[name](renderer.stage)
    after = renderer.render(aovs=AOVS)
    assert equal(after, before) == (name in UNSEEN)
    assert equal(after, fresh(renderer))


@pytest.mark.parametrize("seed", [1, 2])
def test_edits_in_any_order(renderer: Renderer, seed: int) -> None:
    names = [n for n in EDITS if n not in ("a prim that is gone", "a prim of another name")]
    for name in np.random.default_rng(seed).permutation(names)[:10]:
        EDITS[name](renderer.stage)
        renderer.render(aovs=AOVS)
    assert equal(renderer.render(aovs=AOVS), fresh(renderer))


def test_what_is_undone_is_as_before(renderer: Renderer) -> None:
    before = renderer.render(aovs=AOVS)
    for path in ("/World/Red/Surface.inputs:diffuseColor", "/World/Ball.radius", CAMERA):
        found = attribute(renderer.stage, path)
        value = found.Get()
        found.Set(Gf.Vec3f(0, 1, 1) if isinstance(value, Gf.Vec3f) else value * 1.25)
        assert not equal(renderer.render(aovs=AOVS), before)
        found.Set(value)
        assert equal(renderer.render(aovs=AOVS), before)


def test_times_back_and_forth(renderer: Renderer) -> None:
    expected = {time: fresh(renderer, time) for time in (1.0, 1.5, 2.0)}
    assert not equal(expected[1.0], expected[2.0])
    for time in (1.0, 2.0, 1.5, 1.0):
        assert equal(renderer.render(time, AOVS), expected[time])


def test_settings_back_and_forth(renderer: Renderer) -> None:
    first = renderer.render(aovs=AOVS)
    for values in ({"samples": 1}, {"seed": 3}, {"width": 48, "height": 20}, {"max_bounces": 0}):
        before = {key: renderer.settings[key] for key in values}
        renderer.set(**values)
        image = renderer.render(aovs=AOVS)
        with Renderer(renderer.stage, **{**SMALL, **values}) as other:
            assert equal(image, other.render(aovs=AOVS))
        assert not equal(image, first)
        renderer.set(**before)
    assert equal(renderer.render(aovs=AOVS), first)


def test_after_an_error_and_its_repair(renderer: Renderer) -> None:
    before = renderer.render(aovs=AOVS)
    world = renderer.stage.GetPrimAtPath("/World")
    world.SetActive(False)
    for _ in range(2):
        with pytest.raises(StageError):
            renderer.render(aovs=AOVS)
    world.SetActive(True)
    assert equal(renderer.render(aovs=AOVS), before)
    attribute(renderer.stage, "/World/Ball.radius").Set(1.3)
    renderer.camera = "/Nowhere"
    with pytest.raises(StageError):
        renderer.render(aovs=AOVS)
    renderer.camera = "/Camera"
    assert equal(renderer.render(aovs=AOVS), fresh(renderer))


# Edit → most things of each kind that are read of the stage, and made anew in core. All else is kept.
READ = ("rprims_read", "materials_read", "lights_read", "prims_walked", "bindings_resolved")
MADE = ("meshes", "prototypes", "programs", "kernels", "textures")
COSTS: dict[str, dict[str, int]] = {
    "a material's colour": {"materials_read": 1},
    "a material becomes transparent": {"materials_read": 1},
    "a texture's file": {"materials_read": 1, "textures": 1},
    "points": {"rprims_read": 1, "meshes": 1, "prototypes": 1},
    "displayColor": {"rprims_read": 1, "meshes": 1, "prototypes": 1},
    "what is instanced": {"rprims_read": 1, "meshes": 1, "prototypes": 1},
    "an instance's transform": {"prims_walked": 1},
    "visibility": {"prims_walked": 1},
    "a light's intensity": {"lights_read": 1},
    "a light's place": {"lights_read": 1, "prims_walked": 1},
    "the camera's place": {"prims_walked": 1, "textures": 1},
}


def costs(renderer: Renderer) -> dict[str, int]:
    """What the last frame has read and made, where that is anything."""
    found = {name: getattr(renderer.last_sync, name) for name in READ}
    found |= {name: renderer.last_made[name] for name in MADE}
    return {name: count for name, count in found.items() if count}


def test_a_frame_without_an_edit_reads_and_makes_nothing(renderer: Renderer) -> None:
    renderer.render(aovs=AOVS)
    first = costs(renderer)
    assert set(first) == {*READ, *MADE}
    for settings in ({}, {"samples": 1}, {"seed": 4}, {"light_samples": 2}):
        renderer.set(**settings)
        renderer.render(aovs=AOVS)
        assert costs(renderer) == {}
    renderer.set(width=40, height=30)
    renderer.render(aovs=AOVS)
    assert not {"rprims_read", "meshes", "prototypes", "programs"} & set(costs(renderer))


@pytest.mark.parametrize("name", COSTS)
def test_an_edit_costs_what_it_touches(renderer: Renderer, name: str) -> None:
    renderer.render(aovs=AOVS)
    EDITS[name](renderer.stage)
    renderer.render(aovs=AOVS)
    allowed = COSTS[name]
    assert set(costs(renderer)) & set(allowed), "what was edited"
    for what, count in costs(renderer).items():
        assert count <= allowed.get(what, 0), (what, count)


def test_a_frame_reads_again_what_varies_with_time(renderer: Renderer) -> None:
    for time in (1, 2):
        attribute(renderer.stage, "/World/Card.points").Set(
            [(-10, 0, -10), (time, 0, -11), (0, 9, -10), (-10, 10, -10)], time
        )
    renderer.render(1.0, AOVS)
    everything = costs(renderer)
    renderer.render(2.0, AOVS)
    found = costs(renderer)
    assert found["rprims_read"] == found["meshes"] == 1
    assert everything["rprims_read"] >= 7
    assert not {"materials_read", "lights_read", "programs"} & set(found)


def test_programs_that_close_nothing_leave_nothing(tmp_path: Path) -> None:
    """Textures, meshes and callbacks of one frame must not keep each other alive."""
    new_world(tmp_path).Export(str(tmp_path / "a.usda"))
    code = f"""
import encore
renderer = encore.Renderer({str(tmp_path / "a.usda")!r}, width=32, samples=1)
print(renderer.render())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "<RenderResult 32 x 24: color>\n"
