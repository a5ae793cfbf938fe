"""Writes a scene after Fig. 5 of the paper: fine text behind a magnifying glass and a panel of rough glass.

Usage: python examples/paper/make_magnifying_glass.py [OUTPUT.usda] [--quick]

The camera's lens is focused on the image of the text that the magnifying glass makes, so that this image
is sharp while the glass' own rim, and the page itself, are not. Beside it stand a panel of rough glass and a
sphere that a displacement map drives spikes out of.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from parts import (
    Floats,
    Polygons,
    add_camera,
    add_dome,
    add_image,
    add_material,
    add_mesh,
    add_softbox,
    add_texture_coordinates,
    box,
    grid,
    new_stage,
    polygons,
    revolved,
    rounded_box,
    run,
    write_png,
)
from pxr import Sdf, Usd, UsdGeom, UsdShade

# All lengths in centimetres. The page stands in the plane z = 0, the camera looks along -z.
PAGE = (44.0, 28.0)
LENS_Z, LENS_RADIUS, CURVATURE, IOR = 8.0, 4.6, 14.0, 1.5
CAMERA_Z = 52.0
FOCAL_MM, F_STOP = 55.0, 5.0

_GLYPHS = {
    "A": "01110 10001 10001 11111 10001 10001 10001",
    "B": "11110 10001 10001 11110 10001 10001 11110",
    "C": "01111 10000 10000 10000 10000 10000 01111",
    "D": "11110 10001 10001 10001 10001 10001 11110",
    "E": "11111 10000 10000 11110 10000 10000 11111",
    "F": "11111 10000 10000 11110 10000 10000 10000",
    "G": "01111 10000 10000 10011 10001 10001 01111",
    "H": "10001 10001 10001 11111 10001 10001 10001",
    "I": "01110 00100 00100 00100 00100 00100 01110",
    "K": "10001 10010 10100 11000 10100 10010 10001",
    "L": "10000 10000 10000 10000 10000 10000 11111",
    "M": "10001 11011 10101 10101 10001 10001 10001",
    "N": "10001 11001 10101 10101 10011 10001 10001",
    "O": "01110 10001 10001 10001 10001 10001 01110",
    "P": "11110 10001 10001 11110 10000 10000 10000",
    "Q": "01110 10001 10001 10001 10101 10010 01101",
    "R": "11110 10001 10001 11110 10100 10010 10001",
    "S": "01111 10000 10000 01110 00001 00001 11110",
    "T": "11111 00100 00100 00100 00100 00100 00100",
    "U": "10001 10001 10001 10001 10001 10001 01110",
    "V": "10001 10001 10001 10001 10001 01010 00100",
    "W": "10001 10001 10001 10101 10101 11011 10001",
    "X": "10001 10001 01010 00100 01010 10001 10001",
    "Y": "10001 10001 01010 00100 00100 00100 00100",
    "Z": "11111 00001 00010 00100 01000 10000 11111",
    ".": "00000 00000 00000 00000 00000 01100 01100",
    ",": "00000 00000 00000 00000 00110 00100 01000",
}
_WORDS = (
    "EVERY SAMPLE OF A PIXEL SEES THE SAME FEW POINTS OF A SURFACE, SO SHADE THOSE FEW AND LET THE OTHERS "
    "FIND THEIR NEAREST. WHAT FINDS NONE IS SHADED LATE. RAYS ARE MANY, SHADING IS DEAR. "
)


def text_texture(columns: int, lines: int, pixels_per_dot: int) -> Floats:
    """Dark dots on paper: lines of a text that repeats, six by ten dots to a letter."""
    page = np.zeros((lines * 10, columns * 6))
    for line in range(lines):
        for column in range(columns):
            glyph = _GLYPHS.get(_WORDS[(line * (columns + 5) + column) % len(_WORDS)])
            if glyph and 1 <= column < columns - 1:
                dots = [[float(dot) for dot in row] for row in glyph.split()]
                page[line * 10 + 1 : line * 10 + 8, column * 6 : column * 6 + 5] = dots
    ink = np.kron(page, np.ones((pixels_per_dot, pixels_per_dot)))[..., None]
    return np.array((0.93, 0.9, 0.82)) * (1 - ink) + np.array((0.08, 0.07, 0.1)) * ink


def spike_texture(pixels: int, cells: int) -> Floats:
    """Cones in a lattice of cells, 0 between them and along the border: seams of patches meet at 0."""
    y, x = (np.mgrid[0:pixels, 0:pixels] + 0.5) / pixels * cells
    radius = np.hypot(x % 1 - 0.5, y % 1 - 0.5)
    cone = np.clip(1 - radius / 0.42, 0, 1)
    return np.repeat((cone**1.4)[..., None], 3, axis=-1)


def lens(segments: int) -> Polygons:
    """A biconvex lens about the z axis: two spherical caps and a narrow rim."""
    edge = 0.05
    angle = np.linspace(0, np.arcsin(LENS_RADIUS / CURVATURE), segments // 4 + 1)
    cap = np.stack([np.sin(angle), np.cos(angle) - np.cos(angle[-1])], axis=-1) * CURVATURE + (0, edge)
    mesh = revolved(np.concatenate([cap * (1, -1), cap[::-1]]), segments)
    # Its axis is y; turn it to z.
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    return polygons(mesh.points @ turn, mesh.counts, mesh.indices)


def rim(major: float, minor: float, around: int, across: int) -> Polygons:
    a = 2 * np.pi * np.arange(around)[:, None] / around
    b = 2 * np.pi * np.arange(across)[None] / across
    r = major + minor * np.cos(b)
    depth = np.broadcast_to(minor * np.sin(b), (around, across))
    return grid(np.stack([r * np.cos(a), r * np.sin(a), depth], axis=-1), True, True).turned()


def cube_sphere(radius: float, divisions: int) -> tuple[Polygons, Floats]:
    """A sphere of six patches that share their borders' points, and texture coordinates per face corner."""
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, divisions + 1))
    s = np.linspace(0, 1, divisions + 1)
    points: dict[tuple[int, ...], int] = {}
    positions: list[Floats] = []
    indices: list[int] = []
    st: list[tuple[float, float]] = []
    for axis in range(3):
        for sign in (-1, 1):
            for i in range(divisions):
                for j in range(divisions):
                    corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    for a, b in corners if sign > 0 else corners[::-1]:
                        p = np.zeros(3)
                        p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3] = sign, t[a], t[b]
                        p = radius * p / np.linalg.norm(p)
                        key = tuple(int(x) for x in np.round(p * 1e6))
                        if key not in points:
                            points[key] = len(positions)
                            positions.append(p)
                        indices.append(points[key])
                        st.append((float(s[a]), float(s[b])))
    return polygons(positions, [4] * (len(indices) // 4), indices), np.array(st)


def add_spiky_sphere(stage: Usd.Stage, texture: str, divisions: int) -> None:
    """A subdivision surface whose material displaces it by a texture."""
    mesh, st = cube_sphere(2.6, divisions)
    prim = add_mesh(stage, "/World/Spikes", mesh.moved((11.2, -5.6, 6.5), 1.0, 25.0), smooth=False)
    prim.CreateSubdivisionSchemeAttr("catmullClark")
    add_texture_coordinates(prim, st, UsdGeom.Tokens.faceVarying)
    look = add_material(stage, "Orange", diffuseColor=(0.9, 0.33, 0.04), roughness=0.45)
    image = add_image(stage, look, "Height", texture, color_space="raw", wrap="clamp", scale=1.5)
    surface = UsdShade.Shader(stage.GetPrimAtPath(look.GetPath().AppendChild("Surface")))
    surface.CreateInput("displacement", Sdf.ValueTypeNames.Float).ConnectToSource(
        image.CreateOutput("r", Sdf.ValueTypeNames.Float)
    )
    look.CreateDisplacementOutput().ConnectToSource(
        surface.CreateOutput("displacement", Sdf.ValueTypeNames.Token)
    )
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(look)


def image_distance() -> float:
    """From the camera to the image of the page that the lens makes (thin lens equation)."""
    focal = CURVATURE / (2 * (IOR - 1))
    return CAMERA_Z - LENS_Z + LENS_Z * focal / (focal - LENS_Z)


def make(output: Path, quick: bool) -> Usd.Stage:
    settings: dict[str, float] = {"width": 1920, "height": 1080, "samples": 11, "max_bounces": 4}
    if quick:
        settings |= {"width": 320, "height": 180, "samples": 6}
    page, spikes = f"{output.stem}_page.png", f"{output.stem}_spikes.png"
    write_png(output.parent / page, text_texture(128, 56, 3))
    write_png(output.parent / spikes, spike_texture(512, 5))
    stage = new_stage("Text under a magnifying glass, after Fig. 5 of the paper.", settings)

    w, h = PAGE[0] / 2, PAGE[1] / 2
    paper = add_material(stage, "Page", f"./{page}", roughness=0.9, ior=1.0)
    sheet = polygons([(-w, -h, 0), (w, -h, 0), (w, h, 0), (-w, h, 0)], [4], [0, 1, 2, 3])
    prim = add_mesh(stage, "/World/Page", sheet, paper, smooth=False)
    add_texture_coordinates(prim, [(0, 0), (1, 0), (1, 1), (0, 1)])

    segments = 64 if quick else 256
    clear = add_material(stage, "Clear", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=IOR, roughness=0.0)
    steel = add_material(stage, "Steel", diffuseColor=(0.75, 0.73, 0.7), metallic=1.0, roughness=0.2)
    wood = add_material(stage, "Wood", diffuseColor=(0.16, 0.06, 0.03), roughness=0.35)
    place = (-4.0, 1.2, LENS_Z)
    add_mesh(stage, "/World/Lens", lens(segments).moved(place), clear)
    add_mesh(stage, "/World/Rim", rim(LENS_RADIUS + 0.22, 0.32, segments, segments // 4).moved(place), steel)
    handle = rounded_box((1.0, 7.0, 1.0), 16 if quick else 48)
    add_mesh(stage, "/World/Handle", handle.moved((place[0], place[1] - LENS_RADIUS - 3.9, LENS_Z)), wood)

    frosted = add_material(
        stage, "Frosted", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=1.45, roughness=0.28
    )
    add_mesh(stage, "/World/Panel", box((7.0, 12.0, 0.4), (9.2, 2.2, 2.2)), frosted, smooth=False)
    add_spiky_sphere(stage, f"./{spikes}", 4 if quick else 8)

    add_softbox(stage, "Key", (-16, 20, 34), (0, 0, 0), (12, 12), 26.0, (1.0, 0.95, 0.88))
    add_dome(stage, 0.35, (0.8, 0.88, 1.0))
    add_camera(stage, (0.0, 0.0, CAMERA_Z), (0.0, 0.0, 0.0), FOCAL_MM, 16 / 9)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.CreateFStopAttr(F_STOP)
    camera.CreateFocusDistanceAttr(image_distance())
    return stage


if __name__ == "__main__":
    run(__doc__.splitlines()[0], "magnifying_glass.usda", make)
