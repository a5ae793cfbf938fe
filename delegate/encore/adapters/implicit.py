"""UsdGeom's implicit shapes → polygon meshes with smooth normals and st.

A ring has RING_SIDES sides, so that a silhouette stays within 0.031 % of the radius of the true one (0.3
pixels for a circle that is 2000 pixels wide). s runs round the axis, t along it from the bottom; caps, the
plane and the faces of the cube each fill [0, 1]². Spheres, cubes, cylinders and cones are one mesh each,
which the transform stretches to size, so that they share their geometry.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd, UsdGeom

from encore.adapters.context import Matrix, SyncContext, number_of
from encore.adapters.mesh import MeshData
from encore.adapters.primvars import Primvar

RING_SIDES = 128  # also the segments of a full circle from pole to pole, halved
# A profile from the bottom up: radius, height, and the normal's components along both.
Profile = list[tuple[float, float, float, float]]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    """key: arguments of build(). to_prim: from the built mesh to the prim's own space, (4, 4)."""

    key: tuple[Any, ...]
    to_prim: Matrix


def shape_of(prim: Usd.Prim, context: SyncContext) -> Shape | None:
    """The shape of a supported prim at the context's time; None, and a report, where it has no size."""
    kind = str(prim.GetTypeName())
    values = {name: number_of(prim.GetAttribute(name), context.time) for name in _SIZES[kind]}
    if not all(math.isfinite(v) and v >= 0 for v in values.values()) or _is_flat(kind, values):
        text = ", ".join(f"{name} {value:g}" for name, value in values.items())
        context.reports.error("bad implicit shape", f"cannot be rendered with {text}", prim.GetPath())
        return None
    axis = "Z" if kind in ("Sphere", "Cube") else str(prim.GetAttribute("axis").Get(context.time))
    if axis not in _AXES:
        context.reports.error("bad axis", f"axis {axis} is none of X, Y and Z: Z is used", prim.GetPath())
        axis = "Z"
    key, scale = _normalize(kind, values, axis)
    return Shape(key, _frame(axis) * np.array([*scale, 1.0])[:, None])


def is_solid(shape: Shape) -> bool:
    """Whether it is closed: all but planes are."""
    return shape.key[0] != "Plane"


_SIZES: dict[str, tuple[str, ...]] = {
    "Sphere": ("radius",),
    "Cube": ("size",),
    "Cylinder": ("radius", "height"),
    "Cylinder_1": ("radiusBottom", "radiusTop", "height"),
    "Cone": ("radius", "height"),
    "Capsule": ("radius", "height"),
    "Capsule_1": ("radiusBottom", "radiusTop", "height"),
    "Plane": ("width", "length"),
}
TYPES = tuple(_SIZES)
_AXES = {"X": (1, 2, 0), "Y": (2, 0, 1), "Z": (0, 1, 2)}


def _is_flat(kind: str, v: dict[str, float]) -> bool:
    """True where a size is 0 that must not be: a capsule may lack its side, a tapered shape an end."""
    if kind == "Capsule":
        return v["radius"] == 0
    if kind in ("Capsule_1", "Cylinder_1"):
        bottom, top = v["radiusBottom"], v["radiusTop"]
        return max(bottom, top) == 0 or (v["height"] == 0 and (kind == "Cylinder_1" or bottom != top))
    return min(v.values()) == 0


def _normalize(
    kind: str, v: dict[str, float], axis: str
) -> tuple[tuple[Any, ...], tuple[float, float, float]]:
    """The key of build(), and the scale of what it builds, along (u, v, axis)."""
    if kind == "Sphere":
        return ("Sphere",), (v["radius"],) * 3
    if kind == "Cube":
        return ("Cube",), (v["size"] / 2,) * 3
    if kind in ("Cylinder", "Cone"):
        return (kind,), (v["radius"], v["radius"], v["height"] / 2)
    if kind == "Plane":
        # Of the two axes in the plane, u and v, the width lies on u for axis Z and on v for the others.
        u, w = (v["width"], v["length"]) if axis == "Z" else (v["length"], v["width"])
        return ("Plane",), (u / 2, w / 2, 1.0)
    bottom, top = v.get("radiusBottom", v.get("radius", 0.0)), v.get("radiusTop", v.get("radius", 0.0))
    return (kind.removesuffix("_1"), bottom, top, v["height"]), (1.0, 1.0, 1.0)


def _frame(axis: str) -> Matrix:
    """Rows: where the mesh's u, v and axis (its x, y and z) point. Turns, does not mirror."""
    order = _AXES[axis]
    matrix = np.zeros((4, 4))
    matrix[3, 3] = 1
    for row, column in enumerate(order):
        matrix[row, column] = 1
    return matrix


@functools.lru_cache(maxsize=64)
def build(kind: str, *parameters: float) -> MeshData:
    """The mesh of a Shape's key, around its z axis, with an empty path."""
    if kind == "Cube":
        return _cube()
    if kind == "Plane":
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
        return _join([_polygon(corners, np.array([0.0, 0.0, 1.0]))])
    if kind == "Sphere":
        return _join([_revolve(_arc(1.0, 0.0, -90, 90))])
    if kind == "Cylinder":
        return _tapered(1.0, 1.0, 2.0) if not parameters else _tapered(*parameters)
    if kind == "Cone":
        return _tapered(1.0, 0.0, 2.0)
    return _capsule(*parameters)


def _capsule(bottom: float, top: float, height: float) -> MeshData:
    """A side with caps that continue it smoothly; bottom and top: radii of the circles where they meet.

    Where the circles differ, the caps' spheres touch the cone of the side, as UsdGeomCapsule_1 computes its
    extent.
    """
    slope = math.atan2(bottom - top, height)
    degrees = math.degrees(slope)
    parts = [
        _arc(bottom / math.cos(slope), -height / 2 - bottom * math.tan(slope), -90, degrees),
        _side(bottom, top, height),
        _arc(top / math.cos(slope), height / 2 - top * math.tan(slope), degrees, 90),
    ]
    return _join([_revolve(profile) for profile in parts if profile])


def _tapered(bottom: float, top: float, height: float) -> MeshData:
    parts = [_revolve(_side(bottom, top, height))]
    if bottom > 0:
        parts.append(_polygon(_ring(bottom, -height / 2)[::-1], np.array([0.0, 0.0, -1.0])))
    if top > 0:
        parts.append(_polygon(_ring(top, height / 2), np.array([0.0, 0.0, 1.0])))
    return _join(parts)


def _side(bottom: float, top: float, height: float) -> Profile:
    """A straight side; nothing where it has no height."""
    if height <= 0:
        return []
    slant = math.hypot(height, bottom - top)
    normal = height / slant, (bottom - top) / slant
    return [(bottom, -height / 2, *normal), (top, height / 2, *normal)]


def _arc(radius: float, centre: float, first: float, last: float) -> Profile:
    """Part of a half circle between two latitudes in degrees; nothing where it has no radius."""
    if radius <= 0:
        return []
    steps = max(1, math.ceil(RING_SIDES / 360 * (last - first) - 1e-9))
    profile: Profile = []
    for i in range(steps + 1):
        latitude = math.radians(first + (last - first) * i / steps)
        up, out = math.sin(latitude), math.cos(latitude)
        out = 0.0 if out < 1e-12 else out
        profile.append((radius * out, centre + radius * up, out, up))
    return profile


def _ring(radius: float, height: float) -> _Floats:
    angles = np.arange(RING_SIDES) * (2 * np.pi / RING_SIDES)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(RING_SIDES, height)], axis=1)


@dataclass(frozen=True)
class _Part:
    """points (n, 3); counts (faces); per corner: indices, normals (c, 3), st (c, 2)."""

    points: _Floats
    counts: npt.NDArray[np.int64]
    indices: npt.NDArray[np.int64]
    normals: _Floats
    st: _Floats


def _revolve(profile: Profile) -> _Part:
    """The surface that a profile sweeps: quads, and triangles where the radius is 0."""
    rows, sides = len(profile), RING_SIDES
    radius, height, out, up = np.array(profile).T
    points = np.concatenate([_ring(r, h) for r, h in zip(radius, height, strict=True)])
    row = np.repeat(np.arange(rows - 1), sides)
    side = np.tile(np.arange(sides), rows - 1)
    # Corners of each cell, anticlockwise from outside: rows and sides relative to the cell.
    corner_row = row[:, None] + np.array([0, 0, 1, 1])
    corner_side = side[:, None] + np.array([0, 1, 1, 0])
    s, t = corner_side / sides, corner_row / (rows - 1)
    angle = corner_side * (2 * np.pi / sides)
    # At a pole there is one corner, in the middle of the cell, instead of two.
    pole = radius[corner_row] == 0
    middle = (side + 0.5)[:, None]
    s = np.where(pole, middle / sides, s)
    angle = np.where(pole, middle * (2 * np.pi / sides), angle)
    keep = ~pole | np.isin(np.arange(4), (0, 2))
    indices = corner_row * sides + np.where(pole, 0, corner_side % sides)
    normals = np.stack(
        [out[corner_row] * np.cos(angle), out[corner_row] * np.sin(angle), up[corner_row]], axis=-1
    )
    st = np.stack([s, t], axis=-1)
    return _Part(points, keep.sum(axis=1), indices[keep], normals[keep], st[keep])


def _polygon(corners: _Floats, normal: _Floats) -> _Part:
    """One flat face; st fills [0, 1]² over its extent."""
    count = len(corners)
    low, high = corners.min(axis=0)[:2], corners.max(axis=0)[:2]
    st = (corners[:, :2] - low) / (high - low)
    return _Part(corners, np.array([count]), np.arange(count), np.tile(normal, (count, 1)), st)


def _cube() -> MeshData:
    """A cube of edge 2. Every face has st from (0, 0) to (1, 1)."""
    parts = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal, along = np.zeros(3), np.zeros(3)
            normal[axis] = sign
            along[(axis + 1) % 3] = sign
            across = np.cross(normal, along)
            corners = [normal + u * along + w * across for u, w in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            st = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
            parts.append(_Part(np.array(corners), np.array([4]), np.arange(4), np.tile(normal, (4, 1)), st))
    return _join(parts)


def _join(parts: list[_Part]) -> MeshData:
    starts = np.cumsum([0] + [len(p.points) for p in parts[:-1]])
    indices = np.concatenate([p.indices + start for p, start in zip(parts, starts, strict=True)])

    def corners(values: list[_Floats]) -> Primvar:
        return Primvar("faceVarying", np.ascontiguousarray(np.concatenate(values), np.float32), None)

    return MeshData(
        path="",
        points=np.concatenate([p.points for p in parts]).astype(np.float32),
        face_vertex_counts=np.concatenate([p.counts for p in parts]).astype(np.int32),
        face_vertex_indices=indices.astype(np.int32),
        normals=corners([p.normals for p in parts]),
        texcoords={"st": corners([p.st for p in parts])},
    )


def orientation(prim: Usd.Prim, context: SyncContext) -> tuple[bool, bool]:
    """(left-handed, double-sided)."""
    gprim = UsdGeom.Gprim(prim)
    left_handed = gprim.GetOrientationAttr().Get(context.time) == UsdGeom.Tokens.leftHanded
    return left_handed, bool(gprim.GetDoubleSidedAttr().Get(context.time))
