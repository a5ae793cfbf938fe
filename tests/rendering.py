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


def render(stage: Usd.Stage, width: int = 64, height: int = 64, **settings: Any) -> dict[str, Any]:
    """Renders the stage's camera and returns what _core.render returns. settings: core/scene/settings.h."""
    options = SyncOptions(
        width=width,
        height=height,
        camera=settings.pop("camera", ""),
        camera_light=settings.pop("camera_light", True),
        time=Usd.TimeCode(stage.GetStartTimeCode()),
    )
    translation = RenderIndex(stage, options).sync()
    return _core.render(translation.scene, {**settings, "width": width, "height": height}, device())


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


def bind(prim: Any, material: UsdShade.Material) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)


def add_dome(stage: Usd.Stage, radiance: float = 1.0) -> UsdLux.DomeLight:
    dome = UsdLux.DomeLight.Define(stage, "/World/Dome")
    dome.CreateIntensityAttr(radiance)
    return dome


def save_evidence(name: str, **images: np.ndarray) -> Path:
    """Writes float images of a failed test beside each other as EXR; returns the folder."""
    folder = EVIDENCE / name
    folder.mkdir(parents=True, exist_ok=True)
    for key, image in images.items():
        pixels = np.ascontiguousarray(image, np.float32)
        channels = {"RGB": pixels} if pixels.ndim == 3 else {"Y": pixels}
        OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(folder / f"{key}.exr"))
    return folder
