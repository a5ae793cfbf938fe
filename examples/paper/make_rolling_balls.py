"""Writes an animated scene for motion blur and reflection, as Fig. 1 of the paper has them.

Usage: python examples/paper/make_rolling_balls.py [OUTPUT.usda] [--quick]

Patterned balls roll and spin over a polished floor, a cloth waves (its points move), and the camera pans.
Render any frame from 1 to 24 (--frames 12, for one).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from parts import (
    Floats,
    Polygons,
    add_camera,
    add_dome,
    add_material,
    add_mesh,
    add_softbox,
    add_texture_coordinates,
    grid,
    new_stage,
    polygons,
    run,
    write_png,
)
from pxr import Gf, Usd, UsdGeom, Vt

FRAMES = range(0, 26)
TURN_DEGREES = 47.0  # of a ball per frame
RADIUS = 0.5


def stripes(pixels: int) -> Floats:
    """Meridians and dots, so that spin and rolling both show."""
    y, x = (np.mgrid[0:pixels, 0:pixels] + 0.5) / pixels
    meridian = np.clip((np.abs((x * 8) % 1 - 0.5) - 0.25) * pixels / 16, 0, 1)[..., None]
    dot = np.clip((0.3 - np.hypot((x * 16) % 1 - 0.5, (y * 8) % 1 - 0.5)) * pixels / 32, 0, 1)[..., None]
    pattern = (1 - meridian) * (0.85, 0.16, 0.06) + meridian * (0.95, 0.93, 0.88)
    return pattern * (1 - dot) + dot * np.array((0.05, 0.06, 0.1))


def globe(segments: int) -> tuple[Polygons, Floats]:
    """A sphere with a seam, and its texture coordinates per point."""
    polar = np.linspace(0, np.pi, segments // 2 + 1)[:, None]
    turn = np.linspace(0, 2 * np.pi, segments + 1)[None]
    ones = np.ones_like(polar) * np.ones_like(turn)
    direction = np.stack(
        [np.sin(polar) * np.cos(turn), np.cos(polar) * ones, np.sin(polar) * np.sin(turn)], -1
    )
    mesh = grid(direction * RADIUS).turned()
    st = np.stack([turn / (2 * np.pi) * ones, 1 - polar / np.pi * ones], axis=-1).reshape(-1, 2)
    return Polygons(mesh.points, mesh.points / RADIUS, mesh.counts, mesh.indices), st


def cloth(frame: float, divisions: int) -> Floats:
    """Points of a hanging cloth at a frame, (n, 3)."""
    t = np.linspace(0, 1, divisions + 1)
    x, y = np.meshgrid(t, t)
    wave = 0.22 * (1 - y) * np.sin(2 * np.pi * (1.6 * x - 0.11 * frame) + 1.5 * y)
    return np.stack([2.4 * x - 1.2, 0.6 + 1.7 * y, -1.3 + wave], axis=-1).reshape(-1, 3)


def make(output: Path, quick: bool) -> Usd.Stage:
    settings: dict[str, float] = {"width": 1920, "height": 1080, "samples": 11, "max_bounces": 2}
    if quick:
        settings |= {"width": 320, "height": 180, "samples": 6}
    texture = f"{output.stem}_stripes.png"
    write_png(output.parent / texture, stripes(256 if quick else 1024))
    stage = new_stage(
        "Rolling balls, a waving cloth and a panning camera, after Fig. 1 of the paper.", settings
    )
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(24)

    stone = add_material(stage, "Stone", diffuseColor=(0.22, 0.24, 0.27), roughness=0.03, ior=1.5)
    floor = polygons([(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)], [4], [0, 1, 2, 3])
    add_mesh(stage, "/World/Floor", floor, stone, smooth=False)

    paint = add_material(stage, "Paint", f"./{texture}", roughness=0.5)
    mesh, st = globe(32 if quick else 96)
    for i, (z, start) in enumerate(((0.9, -3.4), (-0.2, -1.5))):
        ball = add_mesh(stage, f"/World/Ball{i}", mesh, paint)
        add_texture_coordinates(ball, st)
        move, roll, spin = ball.AddTranslateOp(), ball.AddRotateZOp(), ball.AddRotateYOp()
        for frame in FRAMES:
            angle = TURN_DEGREES * frame
            move.Set(Gf.Vec3d(start + RADIUS * np.radians(angle) * 0.5, RADIUS, z), frame)
            roll.Set(-angle / 2, frame)
            spin.Set(angle * (2 if i else 0.2), frame)

    silk = add_material(stage, "Silk", diffuseColor=(0.1, 0.3, 0.55), roughness=0.4)
    divisions = 12 if quick else 40
    sheet = grid(cloth(0, divisions).reshape(divisions + 1, divisions + 1, 3))
    prim = add_mesh(stage, "/World/Cloth", sheet, silk, smooth=False)
    prim.CreateSubdivisionSchemeAttr("catmullClark")
    prim.CreateDoubleSidedAttr(True)
    for frame in FRAMES:
        points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(cloth(frame, divisions), np.float32))
        prim.GetPointsAttr().Set(points, frame)

    add_softbox(stage, "Key", (-3, 5, 4), (0, 0.5, 0), (2, 2), 22.0, (1.0, 0.95, 0.88))
    add_dome(stage, 0.5, (0.75, 0.85, 1.0))
    add_camera(stage, (0.3, 2.2, 5.4), (0, 0.6, 0), 35.0, 16 / 9)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    pan = camera.AddRotateYOp()
    for frame in FRAMES:
        pan.Set(3.0 - 0.25 * frame, frame)
    return stage


if __name__ == "__main__":
    run(__doc__.splitlines()[0], "rolling_balls.usda", make)
