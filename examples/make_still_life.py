"""Writes still_life.usda and its texture: every layer, a creased subdivision surface, glass, a mirror.

Usage: python examples/make_still_life.py [FOLDER]   (default: this file's folder)
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

TILE_PIXELS = 512


def write_tiles(path: Path) -> None:
    """Writes a floor of hexagonal-looking offset tiles with grout and a little variation, 8-bit sRGB."""
    random = np.random.default_rng(7)
    rows, columns = 8, 4
    y, x = np.mgrid[0:TILE_PIXELS, 0:TILE_PIXELS] / TILE_PIXELS
    row = np.floor(y * rows).astype(int)
    shifted = (x * columns + 0.5 * (row % 2)) % columns
    column = np.floor(shifted).astype(int)
    tints = random.uniform(0.85, 1.05, (rows, columns))[row, column]
    warm = random.uniform(-0.04, 0.04, (rows, columns))[row, column]
    grain = random.normal(0, 0.012, (TILE_PIXELS, TILE_PIXELS))
    tile = np.stack([0.66 + warm, 0.56 + 0 * warm, 0.46 - warm], axis=-1) * (tints + grain)[..., None]
    edge_x = np.minimum(shifted % 1, 1 - shifted % 1) / columns
    edge_y = np.minimum((y * rows) % 1, 1 - (y * rows) % 1) / rows
    grout = np.clip(np.minimum(edge_x, edge_y) * TILE_PIXELS / 3.0, 0, 1)[..., None]
    pixels = np.clip(grout * tile + (1 - grout) * np.array([0.30, 0.28, 0.26]), 0, 1)
    image = oiio.ImageBuf(oiio.ImageSpec(TILE_PIXELS, TILE_PIXELS, 3, oiio.UINT8))
    image.set_pixels(oiio.ROI(), pixels.astype(np.float32))
    image.write(str(path))


def material(
    stage: Usd.Stage, name: str, texture: str | None = None, **inputs: float | tuple[float, float, float]
) -> UsdShade.Material:
    result = UsdShade.Material.Define(stage, f"/World/Looks/{name}")
    surface = UsdShade.Shader.Define(stage, result.GetPath().AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    for key, value in inputs.items():
        kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
        surface.CreateInput(key, kind).Set(value)
    if texture:
        reader = UsdShade.Shader.Define(stage, result.GetPath().AppendChild("St"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        image = UsdShade.Shader.Define(stage, result.GetPath().AppendChild("Tiles"))
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(texture)
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        for wrap in ("wrapS", "wrapT"):
            image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
            image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        )
    result.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return result


def bind(prim: Usd.Prim, look: UsdShade.Material) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(look)


def lathe(
    stage: Usd.Stage,
    path: str,
    profile: list[tuple[float, float, float]],
    segments: int,
    *,
    closed: bool = False,
) -> UsdGeom.Mesh:
    """A Catmull-Clark cage turned about Y. profile: (radius, height, crease sharpness of the ring)."""
    rings = len(profile)
    angles = 2 * np.pi * np.arange(segments) / segments
    points = [
        Gf.Vec3f(float(r * np.cos(a)), float(h), float(-r * np.sin(a))) for r, h, _ in profile for a in angles
    ]
    indices: list[int] = []
    for i in range(rings if closed else rings - 1):
        j = (i + 1) % rings
        for s in range(segments):
            t = (s + 1) % segments
            indices += [i * segments + s, i * segments + t, j * segments + t, j * segments + s]
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points)
    counts = [4] * (len(indices) // 4)
    if not closed:
        # Caps: the profile's first ring looks down, its last one up.
        counts += [segments, segments]
        indices += list(reversed(range(segments)))
        indices += [(rings - 1) * segments + s for s in range(segments)]
    mesh.CreateFaceVertexCountsAttr(counts)
    mesh.CreateFaceVertexIndicesAttr(indices)
    mesh.CreateSubdivisionSchemeAttr("catmullClark")
    creased = [(i, sharpness) for i, (_, _, sharpness) in enumerate(profile) if sharpness > 0]
    if creased:
        ring = [[i * segments + s for s in range(segments)] + [i * segments] for i, _ in creased]
        mesh.CreateCreaseIndicesAttr([index for r in ring for index in r])
        mesh.CreateCreaseLengthsAttr([segments + 1] * len(ring))
        mesh.CreateCreaseSharpnessesAttr([sharpness for _, sharpness in creased])
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    return mesh


def build(stage: Usd.Stage) -> None:
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 0.1)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())

    floor = UsdGeom.Mesh.Define(stage, "/World/Floor")
    floor.CreatePointsAttr([(-9, 0, 6), (9, 0, 6), (9, 0, -9), (-9, 0, -9)])
    floor.CreateFaceVertexCountsAttr([4])
    floor.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    floor.CreateSubdivisionSchemeAttr("none")
    floor.CreateExtentAttr([(-9, 0, -9), (9, 0, 6)])
    st = UsdGeom.PrimvarsAPI(floor).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    st.Set([(0, 0), (6, 0), (6, 5), (0, 5)])
    tiles = material(stage, "Tiles", texture="./still_life_tiles.png", roughness=0.6)
    bind(floor.GetPrim(), tiles)

    wall = UsdGeom.Mesh.Define(stage, "/World/Wall")
    wall.CreatePointsAttr([(-9, 0, -4.2), (9, 0, -4.2), (9, 8, -4.2), (-9, 8, -4.2)])
    wall.CreateFaceVertexCountsAttr([4])
    wall.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    wall.CreateSubdivisionSchemeAttr("none")
    wall.CreateExtentAttr([(-9, 0, -4.2), (9, 8, -4.2)])
    bind(wall.GetPrim(), material(stage, "Plaster", diffuseColor=(0.46, 0.56, 0.58), roughness=0.9))

    # A vase: soft body, hard foot and lip.
    vase = lathe(
        stage,
        "/World/Vase",
        [(0.5, 0, 4), (0.52, 0.12, 3), (0.34, 0.3, 0), (0.95, 1.0, 0), (0.75, 1.75, 0), (0.28, 2.2, 0),
         (0.36, 2.55, 3), (0.46, 2.6, 4), (0.38, 2.62, 4), (0.22, 2.4, 0), (0.2, 2.1, 0)],
        10,
    )  # fmt: skip
    vase.AddTranslateOp().Set((-1.75, 0, -0.5))
    bind(vase.GetPrim(), material(stage, "Glaze", diffuseColor=(0.62, 0.10, 0.06), roughness=0.08))
    UsdGeom.PrimvarsAPI(vase).CreatePrimvar(
        "encore:targetEdgeLength", Sdf.ValueTypeNames.Float, UsdGeom.Tokens.constant
    ).Set(0.03)

    # A faceted block with half-hard edges.
    block = lathe(stage, "/World/Block", [(0.6, 0, 2), (0.6, 0.85, 2)], 6)
    block.AddTranslateOp().Set((0.35, 0, 1.35))
    block.AddRotateYOp().Set(20)
    bind(block.GetPrim(), material(stage, "Slate", diffuseColor=(0.09, 0.16, 0.34), roughness=0.45))

    ring = lathe(
        stage,
        "/World/Ring",
        [(1.0, 0.34, 0), (0.72, 0.64, 0), (0.44, 0.34, 0), (0.72, 0.04, 0)],
        12,
        closed=True,
    )
    ring.AddTranslateOp().Set((2.1, 0.0, 0.9))
    bind(
        ring.GetPrim(),
        material(stage, "Brass", diffuseColor=(0.89, 0.66, 0.32), metallic=1.0, roughness=0.28),
    )

    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(0.78)
    ball.CreateExtentAttr([(-0.78,) * 3, (0.78,) * 3])
    ball.AddTranslateOp().Set((-0.75, 0.78, 1.45))
    bind(
        ball.GetPrim(),
        material(stage, "Glass", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=1.5, roughness=0.0),
    )

    mirror = UsdGeom.Xform.Define(stage, "/World/Mirror")
    mirror.AddTranslateOp().Set((1.2, 1.75, -2.2))
    mirror.AddRotateYOp().Set(-24)
    mirror.AddRotateXOp().Set(-6)
    pane = UsdGeom.Mesh.Define(stage, "/World/Mirror/Pane")
    pane.CreatePointsAttr([(-1.35, -1.6, 0.06), (1.35, -1.6, 0.06), (1.35, 1.6, 0.06), (-1.35, 1.6, 0.06)])
    pane.CreateFaceVertexCountsAttr([4])
    pane.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    pane.CreateSubdivisionSchemeAttr("none")
    pane.CreateExtentAttr([(-1.35, -1.6, 0.06), (1.35, 1.6, 0.06)])
    bind(
        pane.GetPrim(),
        material(stage, "Silver", diffuseColor=(0.93, 0.94, 0.95), metallic=1.0, roughness=0.0),
    )
    frame = UsdGeom.Cube.Define(stage, "/World/Mirror/Frame")
    frame.CreateSizeAttr(1)
    frame.CreateExtentAttr([(-0.5,) * 3, (0.5,) * 3])
    frame.AddScaleOp().Set((2.95, 3.45, 0.1))
    bind(frame.GetPrim(), material(stage, "Walnut", diffuseColor=(0.10, 0.05, 0.03), roughness=0.5))

    window = UsdLux.RectLight.Define(stage, "/World/Window")
    window.CreateWidthAttr(3.5)
    window.CreateHeightAttr(3.5)
    window.CreateIntensityAttr(9.0)
    window.CreateColorAttr((1.0, 0.93, 0.82))
    window.AddTranslateOp().Set((-4.2, 5.2, 3.6))
    window.AddRotateXYZOp().Set((-48, -47, 0))
    sky = UsdLux.DomeLight.Define(stage, "/World/Sky")
    sky.CreateIntensityAttr(0.55)
    sky.CreateColorAttr((0.72, 0.85, 1.0))

    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(42)
    camera.CreateHorizontalApertureAttr(36)
    camera.CreateVerticalApertureAttr(20.25)
    camera.CreateClippingRangeAttr((0.1, 1000))
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(0.5, 3.1, 9.6), Gf.Vec3d(0.2, 1.35, -0.4), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(look.GetInverse())


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    write_tiles(folder / "still_life_tiles.png")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    build(stage)
    layer.comment = "A still life that uses every layer. Written by make_still_life.py."
    layer.Export(str(folder / "still_life.usda"))


if __name__ == "__main__":
    main()
