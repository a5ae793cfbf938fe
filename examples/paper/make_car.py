"""Writes a scene after Fig. 6 of the paper: a car of mirror paint in a studio, about 200,000 polygons.

Usage: python examples/paper/make_car.py [OUTPUT.usdc] [--quick]

The body is lofted: a closed section (two superellipses that meet at the shoulder line) for every station
along x, each measure a smooth curve of x. Windows, lamps, gaps and arches are then cut out of it along the
zeros of functions of position and normal, so that their borders are smooth. Metres; y is up, x forward.
"""

from __future__ import annotations

from collections.abc import Callable
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
    border,
    box,
    curve,
    extruded,
    grid,
    merged,
    new_stage,
    polygon_distance,
    polygons,
    revolved,
    rounded_box,
    run,
    smoothstep,
    split,
    write_png,
)
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

NOSE, TAIL = 2.26, -2.24
AXLES = (1.37, -1.30)
AXLE_HEIGHT, TRACK = 0.335, 0.785
ARCH_RADIUS = 0.392

# Measures along x. Shoulder: where the lower and the upper half of a section meet.
BOTTOM = [(-2.3, 0.30), (-1.9, 0.22), (-1.0, 0.16), (0.8, 0.155), (1.7, 0.17), (2.3, 0.20)]
SHOULDER = [(-2.3, 0.80), (-1.8, 0.90), (-1.2, 0.93), (-0.3, 0.90), (0.7, 0.85), (1.5, 0.76), (2.3, 0.60)]
HALF_WIDTH = [(-2.3, 0.84), (-1.8, 0.90), (-1.3, 0.935), (-0.5, 0.905), (0.4, 0.895), (1.3, 0.915),
              (1.8, 0.89), (2.3, 0.80)]  # fmt: skip
TOP = [(-2.3, 0.97), (-2.05, 1.02), (-1.75, 1.045), (-1.55, 1.09), (-1.25, 1.205), (-0.9, 1.305),
       (-0.45, 1.365), (-0.05, 1.36), (0.22, 1.30), (0.5, 1.185), (0.8, 1.04), (0.98, 0.968), (1.15, 0.945),
       (1.6, 0.875), (2.0, 0.775), (2.3, 0.66)]  # fmt: skip
MIDDLE = [(-2.3, 0.62), (-1.5, 0.55), (1.5, 0.5), (2.3, 0.44)]  # height that nose and tail close at


def stations(count: int) -> Floats:
    """x from tail to nose, spaced evenly along the outline, which turns steeply at both ends."""
    near = np.concatenate([[0], np.logspace(-8, np.log10(0.6), 600)])
    x = np.unique(np.concatenate([TAIL + near, np.linspace(TAIL + 0.6, NOSE - 0.6, 500), NOSE - near]))
    height, width = ends(x)
    length = np.hypot(np.diff(x), np.hypot(0.35 * np.diff(height), 0.6 * np.diff(width)))
    along = np.concatenate([[0], np.cumsum(length)])
    return np.interp(np.linspace(0, along[-1], count), along, x)


def ends(x: Floats) -> tuple[Floats, Floats]:
    """Factors on heights and widths that close the body at nose and tail."""

    def closing(distance: Floats, reach: float, power: float) -> Floats:
        t = np.clip(1 - distance / reach, 0, 1)
        return (1 - t**power) ** (1 / power)

    height = closing(NOSE - x, 0.34, 2.6) * closing(x - TAIL, 0.30, 2.9)
    width = closing(NOSE - x, 0.62, 2.5) * closing(x - TAIL, 0.45, 2.8)
    return height, width


def resampled(section: Floats, count: int) -> Floats:
    """(n, 2) → (count, 2), evenly spaced along the polyline."""
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(section, axis=0).T))])
    t = np.linspace(0, along[-1], count)
    return np.stack([np.interp(t, along, section[:, k]) for k in (0, 1)], axis=-1)


def section(x: float, count: int) -> Floats:
    """(count, 2) of (y, z >= 0): from the middle of the floor around the side to the middle of the roof."""
    at = np.array([x])
    bottom, shoulder, width, top, middle = (
        float(curve(k, at)[0]) for k in (BOTTOM, SHOULDER, HALF_WIDTH, TOP, MIDDLE)
    )
    cabin = float(smoothstep(0.08, 0.3, np.array([top - shoulder]))[0])
    angle = np.linspace(0, np.pi / 2, 400)
    cosine, sine = np.cos(angle), np.sin(angle)

    lower_power = 5.5
    y = shoulder - (shoulder - bottom) * sine ** (2 / lower_power)
    z = width * cosine ** (2 / lower_power)
    waist = np.exp(-(((y - 0.40) / 0.12) ** 2)) * smoothstep(0.95, 0.6, np.abs(at + 0.02))[0]
    crease = np.exp(-(((y - 0.70) / 0.05) ** 2)) * smoothstep(2.0, 1.5, np.abs(at))[0]
    z = z * (1 - 0.045 * waist + 0.008 * crease - 0.05 * smoothstep(0.45, 0.16, y))
    lower = np.stack([y, z], axis=-1)[::-1]

    power = 2.25 + 1.5 * cabin
    rise = top - shoulder
    y = shoulder + rise * sine ** (2 / power)
    z = width * cosine ** (2 / power)
    z = z - cabin * (0.075 * smoothstep(0, 0.05, y - shoulder) * (z / width) + 0.42 * (y - shoulder) * z)
    upper = np.stack([y, z], axis=-1)

    sides = (count * 11) // 20
    points = np.concatenate([resampled(lower, sides), resampled(upper, count - sides + 1)[1:]])
    height, breadth = (float(f[0]) for f in ends(at))
    points[:, 0] = middle + (points[:, 0] - middle) * height
    points[:, 1] *= breadth
    return points


def half_body(rows: int, columns: int) -> Polygons:
    """The half with z >= 0."""
    x = stations(rows)
    points = np.array([[(at, y, z) for y, z in section(float(at), columns)] for at in x])
    points[:, (0, -1), 2] = 0
    mesh = grid(points).turned()
    # Across the plane of symmetry, normals have no z.
    normals = mesh.normals.reshape(rows, columns, 3)
    normals[:, (0, -1), 2] = 0
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    return mesh


Field = Callable[[Floats, Floats], Floats]


def above(values: Floats, *more: Floats) -> Floats:
    return np.minimum.reduce([values, *more])


def outline_side(corners: list[tuple[float, float]], side: float = 0.45) -> Field:
    """Inside an outline in (x, y), on faces that look sideways."""
    return lambda p, n: above(polygon_distance(corners, p[:, 0], p[:, 1]), (n[:, 2] - side) * 0.2)


def ellipse(centre: tuple[float, float], radii: tuple[float, float], lean: float, front: float) -> Field:
    """Inside an ellipse in (z, y) that leans, towards the nose (front = 1) or the tail (front = -1)."""

    def field(p: Floats, n: Floats) -> Floats:
        dz, dy = p[:, 2] - centre[0], p[:, 1] - centre[1] - lean * (p[:, 2] - centre[0])
        inside = 1 - (np.abs(dz / radii[0]) ** 2.5 + np.abs(dy / radii[1]) ** 2.5)
        return above(inside, (front * p[:, 0] - 1.55) * 4)

    return field


DOOR = [(0.80, 0.25), (0.86, 0.55), (0.80, 0.86), (-0.42, 0.915), (-0.50, 0.60), (-0.42, 0.25)]
HOOD = [(0.98, 0.0), (0.98, 0.60), (1.30, 0.70), (1.90, 0.60), (2.06, 0.30), (2.08, 0.0)]
GLASS_SIDE = [(0.74, 0.925), (0.60, 1.02), (0.36, 1.155), (0.12, 1.245), (-0.15, 1.285), (-0.55, 1.28),
              (-0.85, 1.225), (-1.15, 1.115), (-1.32, 1.02), (-1.25, 0.985), (-0.40, 0.95)]  # fmt: skip


def arch(axle: float) -> Field:
    def field(p: Floats, n: Floats) -> Floats:
        distance = np.hypot(p[:, 0] - axle, p[:, 1] - AXLE_HEIGHT) - ARCH_RADIUS
        return np.maximum(distance, 0.55 - p[:, 2])

    return field


def windscreen(p: Floats, n: Floats) -> Floats:
    x, y = p[:, 0], p[:, 1]
    return above((0.52 - n[:, 2]) * 0.3, 0.90 - x, x - 0.14, y - 0.99)


def rear_window(p: Floats, n: Floats) -> Floats:
    x, y = p[:, 0], p[:, 1]
    return above((0.52 - n[:, 2]) * 0.3, -0.86 - x, x + 1.52, y - 1.02)


def grille(p: Floats, n: Floats) -> Floats:
    y, z = p[:, 1], np.abs(p[:, 2])
    return above(0.50 - z - 0.8 * np.abs(y - 0.37), 0.455 - y, y - 0.255, p[:, 0] - 1.6)


def intake(p: Floats, n: Floats) -> Floats:
    y, z = p[:, 1], p[:, 2]
    return above(z - 0.60, 0.80 - z, 0.44 - y - 0.25 * (0.80 - z), y - 0.25, p[:, 0] - 1.5)


def strip(distance: Callable[[Floats], Floats], width: float) -> tuple[Field, Field]:
    """The two sides of a gap along the zero of a distance."""
    return (lambda p, n: width / 2 - distance(p), lambda p, n: distance(p) + width / 2)


def cut_body(half: Polygons) -> dict[str, Polygons]:
    """Half a body → its parts by material."""
    parts: dict[str, list[Polygons]] = {
        k: [] for k in ("Paint", "Trim", "Glass", "Chrome", "Red", "Lamp", "Led")
    }
    rest = half
    for axle in AXLES:
        rest, _ = split(rest, arch(axle))

    def take(field: Field, *materials: tuple[str, Field | None]) -> None:
        """Cuts an area out of the rest; each (material, field) takes what is left of it."""
        nonlocal rest
        area, rest = split(rest, field)
        for name, inner in materials:
            if inner is None:
                parts[name].append(area)
            else:
                piece, area = split(area, inner)
                parts[name].append(piece)

    def shrunk(field: Field, by: float) -> Field:
        return lambda p, n: field(p, n) - by

    # Sills and floor, then windows in rubber frames.
    take(lambda p, n: 0.235 - p[:, 1] + 0.0 * p[:, 0], ("Trim", None))
    side = outline_side(GLASS_SIDE)
    pillar = strip(lambda p: p[:, 0] + 0.42 + 0.25 * (p[:, 1] - 1.1), 0.045)
    area, rest = split(rest, side)
    glass, frame = split(area, shrunk(side, 0.016))
    in_front, behind = split(glass, lambda p, n: -pillar[0](p, n))
    post, behind = split(behind, pillar[1])
    parts["Glass"] += [in_front, behind]
    parts["Trim"] += [frame, post]
    for field in (windscreen, rear_window):
        take(field, ("Glass", shrunk(field, 0.014)), ("Trim", None))

    # Lamps: a dark bezel, and in it the lamp.
    head = ellipse((0.615, 0.605), (0.175, 0.062), 0.10, 1)
    take(head, ("Led", shrunk(head, 0.93)), ("Lamp", shrunk(head, 0.18)), ("Trim", None))
    tail = ellipse((0.60, 0.775), (0.22, 0.065), 0.06, -1)
    take(tail, ("Red", shrunk(tail, 0.15)), ("Trim", None))
    slats = lambda p, n: np.sin((p[:, 1] - 0.245) * 2 * np.pi / 0.035) - 0.45  # noqa: E731
    take(grille, ("Chrome", shrunk(slats, 0.0)), ("Trim", None))
    take(intake, ("Trim", None))

    # Gaps around doors and the hood.
    def doors(p: Floats) -> Floats:
        return np.where(p[:, 2] > 0.5, polygon_distance(DOOR, p[:, 0], p[:, 1]), 1.0)

    def hood(p: Floats) -> Floats:
        mirrored = [(x, -z) for x, z in reversed(HOOD[1:-1])]
        return np.where(p[:, 1] > 0.6, polygon_distance(HOOD[1:-1] + mirrored, p[:, 0], p[:, 2]), 1.0)

    for distance in (doors, hood):
        inner, outer = strip(distance, 0.007)
        within, rest = split(rest, lambda p, n, f=inner: -f(p, n))
        gap, rest = split(rest, outer)
        parts["Trim"].append(gap)
        parts["Paint"].append(within)
    parts["Paint"].append(rest)
    return {name: merged(pieces) for name, pieces in parts.items() if pieces}


def wheel_houses(half: Polygons) -> tuple[Polygons, Polygons]:
    """(painted lips, dark houses) behind the arches of a half body."""
    lips, houses = [], []
    for axle in AXLES:
        body, _ = split(half, arch(axle))
        edges = border(body)
        ends_at = body.points[edges]
        distance = np.hypot(ends_at[..., 0] - axle, ends_at[..., 1] - AXLE_HEIGHT)
        edges = edges[(np.abs(distance - ARCH_RADIUS) < 2e-3).all(1) & (ends_at[..., 2] > 0.55).all(1)]

        def inwards(p: Floats, depth: float) -> Floats:
            return np.concatenate([p[:, :2], np.maximum(p[:, 2:] - depth, 0.5)], axis=1)

        lips.append(extruded(body, edges, lambda p: inwards(p, 0.03)))
        houses.append(extruded(body, edges, lambda p: inwards(p, 1.0)).moved((0, 0, -0.029)))
        houses.append(disc(ARCH_RADIUS + 0.05, 48).moved((axle, AXLE_HEIGHT, 0.5)))
    return merged(lips), merged(houses)


def disc(radius: float, segments: int, inner: float = 0.0) -> Polygons:
    """In the plane z = 0, facing +z."""
    a = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    return grid(np.stack([ring * max(inner, 1e-4), ring * radius]), close_columns=True).turned()


def facing_z(mesh: Polygons) -> Polygons:
    """From turning about y to turning about z."""
    turn = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    return Polygons(mesh.points @ turn, mesh.normals @ turn, mesh.counts, mesh.indices)


def tyre(segments: int, rows: int) -> Polygons:
    """With treads: chevrons and three grooves, cut into the crown."""
    t = np.linspace(-1, 1, rows)
    half, bead = 0.112, 0.228
    angle = t * np.pi * 0.78
    power = 0.45
    across = half * np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** 0.75
    swell = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** power
    radius = np.where(swell > 0, 0.285 + 0.050 * swell, 0.285 + (0.285 - bead) * swell)
    turn = 2 * np.pi * np.arange(segments)[None] / segments
    crown = smoothstep(0.314, 0.322, radius)[:, None]
    lateral = (across / half)[:, None]
    grooves = np.zeros((rows, 1))
    for place in (-0.42, 0.0, 0.42):
        grooves = np.maximum(grooves, 1 - smoothstep(0.03, 0.075, np.abs(lateral - place)))
    phase = (turn * 44 / (2 * np.pi) + 1.1 * np.abs(lateral)) % 1
    chevrons = 1 - smoothstep(0.10, 0.17, np.abs(phase - 0.5))
    depth = 0.009 * crown * np.maximum(grooves, chevrons * (np.abs(lateral) > 0.1))
    r = radius[:, None] - depth
    z = np.broadcast_to(across[:, None], r.shape)
    return grid(np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1), close_columns=True)


def rim(segments: int, rows: int) -> Polygons:
    """Ten spokes in pairs: a dished disc, cut through between them, with thickness; and its barrel."""
    r = np.linspace(0.0, 1.0, rows) * 0.222 + 0.004
    turn = 2 * np.pi * np.arange(segments)[None] / segments
    dish = 0.075 - 0.055 * np.cos(np.clip(r / 0.2, 0, 1) * np.pi / 2)[:, None] ** 2
    dish = dish + 0.012 * smoothstep(0.195, 0.215, r)[:, None]
    z = np.broadcast_to(dish, (rows, segments))
    points = np.stack([r[:, None] * np.cos(turn), r[:, None] * np.sin(turn), z], axis=-1)
    face = grid(points, close_columns=True).turned()

    def spokes(p: Floats, n: Floats) -> Floats:
        radius, angle = np.hypot(p[:, 0], p[:, 1]), np.arctan2(p[:, 1], p[:, 0])
        phase = np.abs((angle * 5 / (2 * np.pi)) % 1 - 0.5) * 2 * np.pi / 5  # from the pair's middle
        spread = 0.05 + 0.045 * radius / 0.2
        bar = (0.018 - np.abs(phase * radius - spread * radius / 0.2)) * 1.0
        return np.maximum.reduce([bar, 0.062 - radius, radius - 0.204])

    kept, _ = split(face, spokes)
    kept = kept.compact()
    back = lambda p: p - np.array([0.0, 0.0, 0.03])  # noqa: E731
    walls = extruded(kept, border(kept), back)
    barrel_profile = np.array([(0.228, 0.092), (0.236, 0.108), (0.226, 0.10), (0.205, 0.05), (0.20, -0.10)])
    barrel = facing_z(revolved(barrel_profile, segments)).turned()
    cap = rounded_box((0.075, 0.075, 0.03), 8, 2.5).moved((0, 0, 0.028))
    return merged([kept, walls, barrel, barrel.turned().moved((0, 0, 0), (1.01, 1.01, 1)), cap])


def add_wheels(stage: Usd.Stage, looks: dict[str, UsdShade.Material], fine: float) -> None:
    """One prototype and four instances; the wheels of the left side are turned around."""
    wheel = stage.CreateClassPrim("/Wheel")
    UsdGeom.Xform.Define(stage, wheel.GetPath())
    stage.GetPrimAtPath("/Wheel").SetSpecifier(Sdf.SpecifierClass)
    segments = 8 * round(44 * fine)
    add_mesh(stage, "/Wheel/Tyre", tyre(segments, round(48 * fine) | 1), looks["Rubber"])
    add_mesh(stage, "/Wheel/Rim", rim(round(240 * fine), round(30 * fine)), looks["Alloy"])
    brake = merged([disc(0.165, 64, 0.05).moved((0, 0, -0.005)), disc(0.21, 64).moved((0, 0, -0.06))])
    add_mesh(stage, "/Wheel/Brake", brake, looks["Steel"])
    caliper = rounded_box((0.07, 0.16, 0.05), 6).moved((-0.13, 0.03, 0.005))
    add_mesh(stage, "/Wheel/Caliper", caliper, looks["Caliper"])
    for end, axle in zip(("Front", "Rear"), AXLES, strict=True):
        for side, sign in (("Right", 1), ("Left", -1)):
            prim = UsdGeom.Xform.Define(stage, f"/World/Car/Wheel{end}{side}")
            prim.AddTranslateOp().Set((axle, AXLE_HEIGHT, sign * TRACK))
            turn = 90.0 * (1 - sign) - (12.0 if end == "Front" else 0.0)
            prim.AddRotateYOp().Set(turn)
            prim.AddRotateZOp().Set(17.0 * sign)
            prim.GetPrim().GetReferences().AddInternalReference("/Wheel")
            prim.GetPrim().SetInstanceable(True)


def add_body(stage: Usd.Stage, looks: dict[str, UsdShade.Material], fine: float) -> None:
    half = half_body(round(338 * fine), round(140 * fine))
    parts = cut_body(half)
    lips, houses = wheel_houses(half)
    parts["Paint"] = merged([parts["Paint"], lips])
    parts["Trim"] = merged([parts["Trim"], houses, houses.turned()])
    # Outside mirrors and handles, once per side.
    housing = rounded_box((0.11, 0.15, 0.22), round(20 * fine), 2.8).moved((0.62, 0.985, 1.0))
    shell, _ = split(housing, lambda p, n: p[:, 0] - 0.58)
    parts["Paint"] = merged([parts["Paint"], shell])
    rim_edges = border(shell)
    centre = np.array([0.58, 0.985, 1.0])
    pane = extruded(shell, rim_edges, lambda p: p * 0.001 + centre * 0.999)
    parts["Chrome"] = merged([parts["Chrome"], pane])
    stalk = rounded_box((0.06, 0.035, 0.16), round(8 * fine), 4.0).moved((0.63, 0.92, 0.90))
    handle = rounded_box((0.17, 0.028, 0.04), round(10 * fine), 3.5).moved((-0.28, 0.79, 0.905))
    parts["Trim"] = merged([parts["Trim"], stalk])
    parts["Chrome"] = merged([parts["Chrome"], handle])
    for name, mesh in parts.items():
        both = merged([mesh, mesh.mirrored()])
        add_mesh(stage, f"/World/Car/{name}", both, looks[name])

    plate = merged([box((0.015, 0.11, 0.50), (2.235, 0.36, 0)), box((0.015, 0.11, 0.50), (-2.235, 0.60, 0))])
    add_mesh(stage, "/World/Car/Plates", plate, looks["Plate"], smooth=False)
    pipe = facing_z(revolved(np.array([(0.036, -0.1), (0.04, 0.0), (0.034, 0.0), (0.032, -0.1)]), 40))
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    pipe = Polygons(pipe.points @ -turn, pipe.normals @ -turn, pipe.counts, pipe.indices)
    pipes = merged([pipe.moved((-2.13, 0.285, z)) for z in (-0.42, -0.33, 0.33, 0.42)])
    add_mesh(stage, "/World/Car/Pipes", merged([pipes, pipes.turned()]), looks["Chrome"])


def floor_texture(pixels: int = 1024) -> Floats:
    """Two by two slabs of stone with thin joints; one metre to a slab."""
    random = np.random.default_rng(11)
    y, x = (np.mgrid[0:pixels, 0:pixels] + 0.5) / pixels
    clouds = np.zeros((pixels, pixels))
    for octave in range(2, 8):
        waves = random.integers(1, 2**octave, (6, 2)) * random.choice([-1, 1], (6, 2))
        phases = random.uniform(0, 2 * np.pi, 6)
        for (kx, ky), phase in zip(waves, phases, strict=True):
            clouds += np.sin(2 * np.pi * (kx * x + ky * y) + phase) * 0.7**octave
    tint = np.array([[0.0, 0.02], [0.025, -0.01]])[(y * 2).astype(int), (x * 2).astype(int)]
    grain = random.normal(0, 0.015, clouds.shape)
    stone = (0.50 + tint + 0.035 * clouds + grain)[..., None] * np.array([1.0, 0.985, 0.96])
    edge = np.minimum(0.5 - np.abs(x * 2 % 1 - 0.5), 0.5 - np.abs(y * 2 % 1 - 0.5))
    joint = np.clip(edge * pixels / 2 / 2.5, 0, 1)[..., None]
    return stone * joint + 0.2 * (1 - joint)


def add_studio(stage: Usd.Stage, texture: str) -> None:
    """A floor that bends up into a wall behind the car, and a low platform."""
    stone = add_material(stage, "Stone", f"./{texture}", roughness=0.8, ior=1.0)
    floor = polygons([(-12, 0, 12), (12, 0, 12), (12, 0, -12), (-12, 0, -12)], [4], [0, 1, 2, 3])
    prim = add_mesh(stage, "/World/Studio/Floor", floor, stone, smooth=False)
    add_texture_coordinates(prim, floor.points[:, (0, 2)] / 2)
    bend = np.linspace(0, np.pi / 2, 17)
    profile = [(9.0, 0.0), *((9 + 3 * np.sin(a), 3 - 3 * np.cos(a)) for a in bend[1:]), (12.0, 9.0)]
    turn = np.radians(np.linspace(85, 305, 97))  # from behind the car's right to its front left
    around = np.stack([np.cos(turn), np.zeros_like(turn), -np.sin(turn)], axis=-1)
    heights = np.array([0.0, 1.0, 0.0])
    wall = grid(np.array([[r * a + y * heights for a in around] for r, y in profile])).turned()
    paper = add_material(stage, "Paper", diffuseColor=(0.60, 0.63, 0.68), roughness=1.0, ior=1.0)
    add_mesh(stage, "/World/Studio/Wall", wall, paper)
    rings = [(r, 0.05) for r in np.linspace(0.01, 2.96, 14)]  # faces about as long as wide
    profile = [*rings, (2.985, 0.045), (2.998, 0.03), (3.0, 0.0)]
    top = revolved(np.array(profile)[::-1], 96)
    slate = add_material(stage, "Slate", diffuseColor=(0.24, 0.25, 0.27), roughness=0.45, ior=1.5)
    add_mesh(stage, "/World/Studio/Platform", top, slate)


def make(output: Path, quick: bool) -> Usd.Stage:
    settings: dict[str, float] = {"width": 1280, "height": 720, "samples": 23, "max_bounces": 2}
    if quick:
        settings |= {"width": 320, "height": 180, "samples": 8}
    texture = f"{output.stem}_floor.png"
    write_png(output.parent / texture, floor_texture())
    stage = new_stage("A car in a studio, after Fig. 6 of the paper.", settings)
    looks = {
        "Paint": add_material(
            stage, "Paint", diffuseColor=(0.80, 0.05, 0.03), metallic=0.8, roughness=0.0, ior=1.6,
            clearcoat=1.0, clearcoatRoughness=0.0,
        ),
        "Glass": add_material(stage, "Glass", diffuseColor=(0.012, 0.014, 0.016), roughness=0.0, ior=1.6),
        "Trim": add_material(stage, "Trim", diffuseColor=(0.018, 0.018, 0.02), roughness=0.5, ior=1.4),
        "Chrome": add_material(
            stage, "Chrome", diffuseColor=(0.80, 0.81, 0.83), metallic=1.0, roughness=0.05
        ),
        "Red": add_material(
            stage, "Red", diffuseColor=(0.45, 0.008, 0.008), emissiveColor=(0.35, 0.01, 0.008),
            roughness=0.0, ior=1.5,
        ),
        "Lamp": add_material(stage, "Lamp", diffuseColor=(0.62, 0.65, 0.70), metallic=0.9, roughness=0.0),
        "Led": add_material(stage, "Led", diffuseColor=(0.0, 0.0, 0.0), emissiveColor=(2.5, 2.7, 3.0)),
        "Rubber": add_material(stage, "Rubber", diffuseColor=(0.022, 0.022, 0.023), roughness=0.7, ior=1.4),
        "Alloy": add_material(stage, "Alloy", diffuseColor=(0.70, 0.71, 0.73), metallic=1.0, roughness=0.15),
        "Steel": add_material(stage, "Steel", diffuseColor=(0.30, 0.29, 0.28), metallic=1.0, roughness=0.4),
        "Caliper": add_material(stage, "Caliper", diffuseColor=(0.75, 0.50, 0.03), roughness=0.3, ior=1.5),
        "Plate": add_material(stage, "Plate", diffuseColor=(0.75, 0.75, 0.72), roughness=0.5, ior=1.5),
    }  # fmt: skip
    fine = 0.4 if quick else 1.0
    add_studio(stage, texture)
    add_body(stage, looks, fine)
    add_wheels(stage, looks, fine)
    car = UsdGeom.Xform.Define(stage, "/World/Car")
    car.AddTranslateOp().Set(Gf.Vec3d(0, 0.05, 0))

    add_softbox(stage, "Overhead", (0.2, 4.6, 0.3), (0.2, 0, 0.3), (5.2, 1.7), 12.0, (1.0, 0.98, 0.95))
    add_softbox(stage, "Side", (1.5, 2.6, 7.5), (0.3, 0.4, 0), (7.0, 1.2), 9.0, (1.0, 0.95, 0.88))
    add_softbox(stage, "Nose", (7.5, 2.8, 0.5), (1.0, 0.5, 0), (1.2, 3.0), 6.0, (0.88, 0.94, 1.0))
    add_softbox(stage, "Back", (-4.0, 3.8, -5.0), (-0.5, 0.8, 0), (3.0, 1.0), 14.0, (0.85, 0.92, 1.0))
    add_dome(stage, 0.45, (0.8, 0.88, 1.0))
    add_camera(stage, (5.3, 1.75, 5.2), (0.10, 0.58, 0.0), 46.0, 16 / 9)
    return stage


if __name__ == "__main__":
    run(__doc__.splitlines()[0], "car.usdc", make)
