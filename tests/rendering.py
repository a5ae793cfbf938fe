"""What image tests and the bench share: small stages, rendering to arrays, and evidence on failure."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from encore import _core
from encore.render_index import RenderIndex, SyncOptions
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

ROOT = Path(__file__).resolve().parent.parent
EVIDENCE = ROOT / "tests" / "output"
ASSETS = ROOT.parent / "shared" / "assets"


@functools.cache
def device() -> _core.Device:
    """One device for the process: its kernels are compiled once."""
    return _core.create_device("", False)


def total(result: dict[str, Any], count: str) -> int:
    """A count of the statistics, summed over the layers."""
    return sum(layer[count] for layer in result["statistics"]["layers"].values())


def translate(
    stage: Usd.Stage, width: int, height: int, camera: str = "", camera_light: bool = True
) -> _core.Scene:
    options = SyncOptions(
        width=width,
        height=height,
        camera=camera,
        camera_light=camera_light,
        time=Usd.TimeCode(stage.GetStartTimeCode()),
    )
    return RenderIndex(stage, options).sync().scene


def render(stage: Usd.Stage, width: int = 64, height: int = 64, **settings: Any) -> dict[str, Any]:
    """Renders the stage's camera and returns what _core.render returns. settings: core/scene/settings.h."""
    scene = translate(stage, width, height, settings.pop("camera", ""), settings.pop("camera_light", True))
    return _core.render(scene, {**settings, "width": width, "height": height}, device())


def new_stage() -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/World")
    return stage


def add_camera(
    stage: Usd.Stage,
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    half_tangent: float = 0.5,
    up: tuple[float, float, float] = (0, 1, 0),
) -> UsdGeom.Camera:
    """A square-filmed camera; half_tangent is the tangent of half its field of view."""
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(10.0)
    camera.CreateHorizontalApertureAttr(20.0 * half_tangent)
    camera.CreateVerticalApertureAttr(20.0 * half_tangent)
    camera.CreateClippingRangeAttr((1e-3, 1e9))
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(*up))
    camera.AddTransformOp().Set(look.GetInverse())
    return camera


def add_mesh(
    stage: Usd.Stage,
    path: str,
    points: Any,
    faces: list[list[int]],
    material: UsdShade.Material | None = None,
    scheme: str = "none",
) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
    mesh.CreateFaceVertexCountsAttr([len(f) for f in faces])
    mesh.CreateFaceVertexIndicesAttr([i for f in faces for i in f])
    mesh.CreateSubdivisionSchemeAttr(scheme)
    if material:
        bind(mesh, material)
    return mesh


def add_plane(
    stage: Usd.Stage, path: str, size: float, material: UsdShade.Material | None = None, y: float = 0.0
) -> UsdGeom.Mesh:
    """A square in xz around the y axis, facing up."""
    h = size / 2
    return add_mesh(stage, path, [(-h, y, h), (h, y, h), (h, y, -h), (-h, y, -h)], [[0, 1, 2, 3]], material)


def add_material(stage: Usd.Stage, name: str, **inputs: Any) -> UsdShade.Material:
    """A UsdPreviewSurface with constant inputs; without `ior` in inputs it has no specular interface."""
    material = UsdShade.Material.Define(stage, f"/World/Looks/{name}")
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    for key, value in {"ior": 1.0, **inputs}.items():
        if isinstance(value, tuple):
            kind = Sdf.ValueTypeNames.Color3f
        else:
            kind = Sdf.ValueTypeNames.Int if isinstance(value, int) else Sdf.ValueTypeNames.Float
        shader.CreateInput(key, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material


def surface(material: UsdShade.Material) -> UsdShade.Shader:
    """The shader of add_material()."""
    stage = material.GetPrim().GetStage()
    return UsdShade.Shader(stage.GetPrimAtPath(material.GetPath().AppendChild("Surface")))


def add_image(
    material: UsdShade.Material, name: str, file: str, primvar: str = "st", **inputs: Any
) -> UsdShade.Shader:
    """A UsdUVTexture that repeats, of raw values. inputs: of four floats."""
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    reader = UsdShade.Shader.Define(stage, path.AppendChild(f"{name}Reader"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    image = UsdShade.Shader.Define(stage, path.AppendChild(name))
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
    for key in ("wrapS", "wrapT"):
        image.CreateInput(key, Sdf.ValueTypeNames.Token).Set("repeat")
    for key, value in inputs.items():
        image.CreateInput(key, Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*value))
    st = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
    return image


def connect(material: UsdShade.Material, name: str, source: UsdShade.Shader, output: str, kind: Any) -> None:
    """Connects an input of the material's surface to an output."""
    surface(material).CreateInput(name, kind).ConnectToSource(source.CreateOutput(output, kind))


def add_texcoords(mesh: UsdGeom.Mesh, st: Any, name: str = "st") -> UsdGeom.Primvar:
    """st: a pair per point."""
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        name, Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    )
    primvar.Set([Gf.Vec2f(*map(float, pair)) for pair in st])
    return primvar


def bind(prim: Any, material: UsdShade.Material) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)


def add_dome(stage: Usd.Stage, radiance: float = 1.0) -> UsdLux.DomeLight:
    dome = UsdLux.DomeLight.Define(stage, "/World/Dome")
    dome.CreateIntensityAttr(radiance)
    return dome


def add_area_light(stage: Usd.Stage, intensity: float = 8.0) -> UsdLux.RectLight:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateIntensityAttr(intensity)
    light.AddTranslateOp().Set((1, 3, 1))
    light.AddRotateXOp().Set(-90)
    return light


CUBE = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
CUBE_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def mixed_stage() -> Usd.Stage:
    """All three layers in a small frame: a floor of quads, a mirror, a glass ball, rounded boxes as
    instances, and dust of faces below a pixel."""
    stage = new_stage()
    add_dome(stage, 0.5)
    add_area_light(stage)
    grey = add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5))
    red = add_material(stage, "Red", diffuseColor=(0.8, 0.2, 0.1), ior=1.5, roughness=0.05)
    silver = add_material(stage, "Silver", diffuseColor=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.0)
    glass = add_material(stage, "Glass", opacity=0.0, ior=1.5, roughness=0.0)
    n = 4
    t = np.linspace(-4, 4, n + 1)
    points = [(x, 0.0, z) for z in t for x in t]
    faces = [
        [i * (n + 1) + j, (i + 1) * (n + 1) + j, (i + 1) * (n + 1) + j + 1, i * (n + 1) + j + 1]
        for i in range(n)
        for j in range(n)
    ]
    add_mesh(stage, "/World/Floor", points, faces, grey)
    pane = [(-2, 0.1, -1.5), (2, 0.1, -1.5), (2, 2.2, -1.5), (-2, 2.2, -1.5)]
    add_mesh(stage, "/World/Mirror", pane, [[0, 1, 2, 3]], silver)
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(0.45)
    ball.AddTranslateOp().Set((0.7, 0.46, 0.5))
    bind(ball, glass)
    stage.CreateClassPrim("/Box")
    add_mesh(stage, "/Box/Mesh", CUBE, CUBE_FACES, None, "catmullClark")
    for i in range(3):
        box = UsdGeom.Xform.Define(stage, f"/World/Box{i}")
        box.AddTranslateOp().Set((-1.3 + 0.7 * i, 0.35, 0.2 - 0.4 * i))
        box.AddRotateYOp().Set(25.0 * i)
        box.AddScaleOp().Set((0.6, 0.6, 0.6))
        box.GetPrim().GetReferences().AddInternalReference("/Box")
        box.GetPrim().SetInstanceable(True)
        bind(box, red)
    k = 24
    x, y = np.meshgrid(np.linspace(-0.25, 0.25, k + 1), np.linspace(0.0, 0.5, k + 1))
    dust = np.stack([x - 0.6, y, 0.9 + 0 * x], axis=-1).reshape(-1, 3)
    faces = [
        [i * (k + 1) + j, i * (k + 1) + j + 1, (i + 1) * (k + 1) + j + 1, (i + 1) * (k + 1) + j]
        for i in range(k)
        for j in range(k)
    ]
    add_mesh(stage, "/World/Dust", dust, faces, grey)
    add_camera(stage, (0.4, 1.5, 3.4), (0, 0.6, 0), 0.45)
    return stage


RATES = (0.25, 1.0, 2.0, 8.0)


def four_rates_stage() -> Usd.Stage:
    """Four columns of shading rates RATES: above a rounded box each, with the rate on its own prim; below an
    instance, turned, with the rate on the instance. Nothing else is seen, and no two objects share a column
    and row of cell_of_rate()."""
    stage = new_stage()
    add_dome(stage)
    grey = add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5))
    box = stage.CreateClassPrim("/Box")
    add_mesh(stage, "/Box/Mesh", CUBE, CUBE_FACES, grey)
    for i, rate in enumerate(RATES):
        x = 2.0 * i - 3.0
        above = add_mesh(stage, f"/World/Own{i}", CUBE, CUBE_FACES, grey, "catmullClark")
        above.AddTranslateOp().Set((x, 1, 0))
        above.AddScaleOp().Set((1.7, 1.7, 1.7))
        below = UsdGeom.Xform.Define(stage, f"/World/Instance{i}")
        below.AddTranslateOp().Set((x, -1, 0))
        below.AddRotateXYZOp().Set((20.0 + 10 * i, 35.0 * i, 0))
        below.GetPrim().GetReferences().AddInternalReference(box.GetPath())
        below.GetPrim().SetInstanceable(True)
        for prim in (above, below):
            set_shading_rate(prim, rate)
    camera = add_camera(stage, (0, 0, 40), (0, 0, 0), 0.1)
    camera.GetVerticalApertureAttr().Set(1.0)
    return stage


def cell_of_rate(image: np.ndarray, column: int, row: int) -> np.ndarray:
    """The part of an image of four_rates_stage(), whose sides are 2 : 1, that shows one object."""
    height, width = image.shape[0] // 2, image.shape[1] // len(RATES)
    return image[row * height : (row + 1) * height, column * width : (column + 1) * width]


def set_shading_rate(prim: Any, rate: float, layer: str = "") -> None:
    """primvars:encore:shadingRate, or that of one layer."""
    name = f"encore:shadingRate:{layer}" if layer else "encore:shadingRate"
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, Sdf.ValueTypeNames.Float, UsdGeom.Tokens.constant).Set(rate)


def arrays_of(result: dict[str, Any]) -> dict[str, np.ndarray]:
    """Every image of a result, by a name of its own."""
    found = {key: value for key, value in result.items() if isinstance(value, np.ndarray)}
    found |= {f"layers.{name}": image for name, image in result["layers"].items()}
    for layer, images in result.get("debug", {}).items():
        found |= {f"debug.{layer}.{name}": image for name, image in images.items()}
    return found


def assert_identical(a: dict[str, Any], b: dict[str, Any], note: str = "") -> None:
    """Every image of two results, bit for bit."""
    first, second = arrays_of(a), arrays_of(b)
    assert first.keys() == second.keys(), note
    for key, image in first.items():
        np.testing.assert_array_equal(image, second[key], err_msg=f"{note}: {key}")


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a.astype(float) - b.astype(float)) ** 2)))


def write_exr(path: Path, pixels: np.ndarray) -> str:
    """(height, width, 3) or (height, width); the file's name."""
    values = np.ascontiguousarray(pixels, np.float32)
    channels = {"RGB": values} if values.ndim == 3 else {"Y": values}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(path))
    return str(path)


def save_evidence(name: str, **images: np.ndarray) -> Path:
    """Writes float images of a failed test beside each other as EXR; returns the folder."""
    folder = EVIDENCE / name
    folder.mkdir(parents=True, exist_ok=True)
    for key, image in images.items():
        write_exr(folder / f"{key}.exr", image)
    return folder
