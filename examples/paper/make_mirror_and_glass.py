"""Writes a scene after Fig. 4 of the paper: a large mirror that reflects the ground and a glass ball.

Usage: python examples/paper/make_mirror_and_glass.py [OUTPUT.usda] [--quick]

In the mirror, the ground is seen on two ways: directly reflected, and through the ball, where footprints of
texture filters are many times wider. Both lie in one layer, and shading may be reused between them: dots in
the fine pattern of the ground (Fig. 4 b), unless reuse minds footprints (--footprintReuse).
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
    box,
    grid,
    new_stage,
    polygons,
    run,
    write_png,
)
from pxr import Usd

GROUND_SIZE = 12.0
TEXTURE_REPEATS = 8.0
TEXTURE_PIXELS = 1024


def ground_texture() -> Floats:
    """White tiles with a dark rosette and dark ones with a white rosette: mid-grey where filtered widely."""
    cells = 4
    y, x = (np.mgrid[0:TEXTURE_PIXELS, 0:TEXTURE_PIXELS] + 0.5) / TEXTURE_PIXELS * cells
    u, v = x % 1 - 0.5, y % 1 - 0.5
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    odd = (np.floor(x) + np.floor(y)) % 2 == 1
    softness = TEXTURE_PIXELS / cells / 2  # edges are two texels wide
    ring = np.clip((np.abs(radius - 0.33) - 0.075) * softness, 0, 1)
    rays = np.clip((np.abs(np.sin(4 * angle)) - 0.35) * radius * softness / 4, 0, 1)
    heart = np.clip((radius - 0.1) * softness, 0, 1)
    star = np.where(radius < 0.255, np.maximum(rays, 1 - heart), 1)
    ink = 1 - ring * star
    joint = 1 - np.clip((0.5 - np.maximum(np.abs(u), np.abs(v)) - 0.02) * softness, 0, 1)
    paper, night, wine = (np.array(c) for c in ((0.96, 0.95, 0.92), (0.05, 0.07, 0.13), (0.24, 0.04, 0.05)))
    ground = np.where(odd[..., None], night, paper)
    drawing = np.where(odd[..., None], paper, wine)
    pixels = ground * (1 - ink[..., None]) + drawing * ink[..., None]
    return pixels * (1 - joint[..., None]) + 0.16 * joint[..., None]


def ball(radius: float, segments: int) -> Polygons:
    """A sphere of quads, its poles left and right, where no ray of interest passes."""
    polar = np.linspace(0, np.pi, segments // 2 + 1)[:, None]
    turn = 2 * np.pi * np.arange(segments)[None] / segments
    shape = np.broadcast_shapes(polar.shape, turn.shape)
    direction = np.stack(
        [np.broadcast_to(np.cos(polar), shape), np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn)],
        axis=-1,
    )
    mesh = grid(direction * radius, close_columns=True).turned()
    return Polygons(mesh.points, mesh.points / radius, mesh.counts, mesh.indices)


def torus(major: float, minor: float, around: int, across: int) -> Polygons:
    a = 2 * np.pi * np.arange(around)[:, None] / around
    b = 2 * np.pi * np.arange(across)[None] / across
    r = major + minor * np.cos(b)
    height = np.broadcast_to(minor * np.sin(b), (around, across))
    return grid(np.stack([r * np.cos(a), height, -r * np.sin(a)], axis=-1), True, True).turned()


def make(output: Path, quick: bool) -> Usd.Stage:
    settings: dict[str, float] = {"width": 720, "height": 480, "samples": 13, "max_bounces": 6}
    if quick:
        settings |= {"width": 240, "height": 160, "samples": 6}
    texture = f"{output.stem}_ground.png"
    write_png(output.parent / texture, ground_texture())
    stage = new_stage("A mirror, a glass ball and a rough torus, after Fig. 4 of the paper.", settings)

    h, r = GROUND_SIZE / 2, TEXTURE_REPEATS
    ground = polygons([(-h, 0, h), (h, 0, h), (h, 0, -h), (-h, 0, -h)], [4], [0, 1, 2, 3])
    paving = add_material(stage, "Paving", f"./{texture}", roughness=0.9, ior=1.0)
    prim = add_mesh(stage, "/World/Ground", ground, paving, smooth=False)
    add_texture_coordinates(prim, [(0, 0), (r, 0), (r, r), (0, r)])

    silver = add_material(stage, "Silver", diffuseColor=(0.92, 0.93, 0.94), metallic=1.0, roughness=0.0)
    pane = polygons(
        [(-2.6, 0.12, -1.6), (2.6, 0.12, -1.6), (2.6, 2.75, -1.28), (-2.6, 2.75, -1.28)], [4], [0, 1, 2, 3]
    )
    add_mesh(stage, "/World/Mirror", pane, silver, smooth=False)
    walnut = add_material(stage, "Walnut", diffuseColor=(0.09, 0.045, 0.025), roughness=0.6)
    for name, size, centre in (
        ("Foot", (5.5, 0.12, 0.3), (0.0, 0.06, -1.66)),
        ("Left", (0.15, 2.8, 0.5), (-2.675, 1.4, -1.55)),
        ("Right", (0.15, 2.8, 0.5), (2.675, 1.4, -1.55)),
    ):
        add_mesh(stage, f"/World/Frame{name}", box(size, centre), walnut, smooth=False)

    segments = 96 if quick else 320
    glass = add_material(stage, "Glass", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=1.5, roughness=0.0)
    add_mesh(stage, "/World/Ball", ball(0.62, segments).moved((-0.75, 0.64, 0.25)), glass)
    copper = add_material(stage, "Copper", diffuseColor=(0.86, 0.47, 0.30), metallic=1.0, roughness=0.25)
    ring = torus(0.52, 0.2, segments, segments // 2)
    add_mesh(stage, "/World/Torus", ring.moved((1.05, 0.2, 0.35)), copper)

    add_softbox(stage, "Key", (-3.2, 4.6, 3.4), (0, 0.3, 0), (1.8, 1.8), 16.0, (1.0, 0.94, 0.85))
    add_dome(stage, 0.6, (0.75, 0.86, 1.0))
    add_camera(stage, (1.2, 2.1, 5.6), (0.05, 0.78, -0.6), 40.0, 1.5)
    return stage


if __name__ == "__main__":
    run(__doc__.splitlines()[0], "mirror_and_glass.usda", make)
