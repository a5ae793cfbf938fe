"""What the scenes after the paper's figures are made of: polygon meshes as arrays, and USD around them.

Needs only usd-core and numpy. Everything is a function of its arguments: equal calls make equal files.
"""

from __future__ import annotations

import argparse
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Vector = tuple[float, float, float]


@dataclass
class Polygons:
    """Faces of any number of corners. points, normals: (n, 3); counts: (f,); indices: (counts.sum(),)."""

    points: Floats
    normals: Floats
    counts: Ints
    indices: Ints

    @property
    def starts(self) -> Ints:
        return np.concatenate([[0], np.cumsum(self.counts)[:-1]]).astype(np.int64)

    def faces(self, keep: NDArray[np.bool_]) -> Polygons:
        """Some of the faces, over the same points."""
        return Polygons(
            self.points, self.normals, self.counts[keep], self.indices[np.repeat(keep, self.counts)]
        )

    def compact(self) -> Polygons:
        """Without points that no face uses."""
        used, indices = np.unique(self.indices, return_inverse=True)
        return Polygons(self.points[used], self.normals[used], self.counts, indices)

    def mirrored(self) -> Polygons:
        """The image under z -> -z, faces turned so that they keep looking outwards."""
        flip = np.array([1.0, 1.0, -1.0])
        face = np.repeat(np.arange(len(self.counts)), self.counts)
        corner = np.arange(len(self.indices)) - self.starts[face]
        reverse = self.starts[face] + self.counts[face] - 1 - corner
        return Polygons(self.points * flip, self.normals * flip, self.counts, self.indices[reverse])

    def turned(self) -> Polygons:
        """Seen from the other side."""
        other = self.mirrored()
        return Polygons(self.points, -self.normals, self.counts, other.indices)

    def moved(self, offset: ArrayLike, scale: ArrayLike = 1.0, yaw_degrees: float = 0.0) -> Polygons:
        """Scaled by positive factors, then turned about y, then moved."""
        factors = np.broadcast_to(np.asarray(scale, float), 3)
        c, s = np.cos(np.radians(yaw_degrees)), np.sin(np.radians(yaw_degrees))
        turn = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        return Polygons(
            self.points * factors @ turn + np.asarray(offset, float),
            unit(self.normals / factors @ turn),
            self.counts,
            self.indices,
        )


def unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def smooth_normals(points: Floats, counts: Ints, indices: Ints) -> Floats:
    """Area-weighted means of the normals of the faces around each point (Newell's formula per face)."""
    face = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    corner = np.arange(len(indices)) - starts[face]
    following = indices[starts[face] + (corner + 1) % counts[face]]
    local = points - points.mean(axis=0)
    per_face = np.add.reduceat(np.cross(local[indices], local[following]), starts)
    sums = np.zeros_like(points)
    np.add.at(sums, indices, per_face[face])
    return unit(sums)


def polygons(points: ArrayLike, counts: ArrayLike, indices: ArrayLike) -> Polygons:
    p, c, i = np.asarray(points, float), np.asarray(counts, np.int64), np.asarray(indices, np.int64)
    return Polygons(p, smooth_normals(p, c, i), c, i)


def grid(points: Floats, close_rows: bool = False, close_columns: bool = False) -> Polygons:
    """Quads between neighbours of a (rows, columns, 3) array, wound row by row."""
    rows, columns = points.shape[:2]
    r = np.arange(rows if close_rows else rows - 1)
    c = np.arange(columns if close_columns else columns - 1)
    r0, c0 = (a.ravel() for a in np.meshgrid(r, c, indexing="ij"))
    r1, c1 = (r0 + 1) % rows, (c0 + 1) % columns
    quads = np.stack([r0 * columns + c0, r0 * columns + c1, r1 * columns + c1, r1 * columns + c0], axis=-1)
    return polygons(points.reshape(-1, 3), np.full(len(quads), 4), quads.ravel())


def merged(meshes: list[Polygons]) -> Polygons:
    meshes = [m.compact() for m in meshes]
    offsets = np.cumsum([0] + [len(m.points) for m in meshes])
    return Polygons(
        np.concatenate([m.points for m in meshes]),
        np.concatenate([m.normals for m in meshes]),
        np.concatenate([m.counts for m in meshes]),
        np.concatenate([m.indices + o for m, o in zip(meshes, offsets[:-1], strict=True)]),
    )


def flat(mesh: Polygons) -> Polygons:
    """Every face with corners and a normal of its own."""
    points = mesh.points[mesh.indices]
    return polygons(points, mesh.counts, np.arange(len(points)))


def split(mesh: Polygons, field: Callable[[Floats, Floats], Floats]) -> tuple[Polygons, Polygons]:
    """Cuts along the zero of a field: (where it is positive, where it is negative).

    field: of points and normals, (n,). It is taken as linear along edges, so that cuts are smooth however
    coarse the faces are.
    """
    values = field(mesh.points, mesh.normals)
    values = np.where(np.abs(values) < 1e-7, 1e-7, values)
    positive = values[mesh.indices] > 0
    inside = np.add.reduceat(positive.astype(np.int64), mesh.starts)
    crossed = (inside > 0) & (inside < mesh.counts)
    points, normals, new = list[Floats](), list[Floats](), dict[tuple[int, int], int]()

    def between(a: int, b: int) -> int:
        edge = (min(a, b), max(a, b))
        if edge not in new:
            new[edge] = len(mesh.points) + len(points)
            t = values[edge[0]] / (values[edge[0]] - values[edge[1]])
            points.append(mesh.points[edge[0]] * (1 - t) + mesh.points[edge[1]] * t)
            normals.append(unit(mesh.normals[edge[0]] * (1 - t) + mesh.normals[edge[1]] * t))
        return new[edge]

    parts: tuple[list[list[int]], list[list[int]]] = ([], [])
    for start, count in zip(mesh.starts[crossed], mesh.counts[crossed], strict=True):
        corners = [int(i) for i in mesh.indices[start : start + count]]
        pieces: tuple[list[int], list[int]] = ([], [])
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            side = 0 if values[a] > 0 else 1
            pieces[side].append(a)
            if (values[a] > 0) != (values[b] > 0):
                cut = between(a, b)
                pieces[side].append(cut)
                pieces[1 - side].append(cut)
        for side in (0, 1):
            if len(pieces[side]) > 2:
                parts[side].append(pieces[side])
    if points:
        all_points = np.concatenate([mesh.points, points])
        all_normals = np.concatenate([mesh.normals, normals])
    else:
        all_points, all_normals = mesh.points, mesh.normals
    results = []
    for side, whole in enumerate((inside == mesh.counts, inside == 0)):
        kept = mesh.faces(whole)
        counts = np.concatenate([kept.counts, [len(p) for p in parts[side]]]).astype(np.int64)
        indices = np.concatenate([kept.indices, [i for p in parts[side] for i in p]]).astype(np.int64)
        results.append(Polygons(all_points, all_normals, counts, indices))
    return results[0], results[1]


def border(mesh: Polygons) -> Ints:
    """(n, 2): edges that one face only uses, in that face's direction."""
    face = np.repeat(np.arange(len(mesh.counts)), mesh.counts)
    corner = np.arange(len(mesh.indices)) - mesh.starts[face]
    following = mesh.indices[mesh.starts[face] + (corner + 1) % mesh.counts[face]]
    size = len(mesh.points)
    forward, backward = mesh.indices * size + following, following * size + mesh.indices
    alone = ~np.isin(forward, backward)
    return np.stack([mesh.indices[alone], following[alone]], axis=-1)


def extruded(mesh: Polygons, edges: Ints, move: Callable[[Floats], Floats]) -> Polygons:
    """Quads from border edges to where `move` takes their points."""
    used, local = np.unique(edges, return_inverse=True)
    local = local.reshape(edges.shape)
    here = mesh.points[used]
    points = np.concatenate([here, move(here)])
    quads = np.stack([local[:, 1], local[:, 0], local[:, 0] + len(used), local[:, 1] + len(used)], axis=-1)
    return polygons(points, np.full(len(quads), 4), quads.ravel())


def revolved(profile: Floats, segments: int) -> Polygons:
    """A closed turn of (radius, height) points about y; outwards to the right of the profile's direction."""
    angles = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angles), np.zeros(segments), -np.sin(angles)], axis=-1)
    points = profile[:, None, :1] * ring + profile[:, None, 1:] * np.array([0.0, 1.0, 0.0])
    return grid(points, close_columns=True)


def box(size: Vector, centre: Vector = (0, 0, 0)) -> Polygons:
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
    return flat(polygons(corners * size + np.array(centre), [4] * 6, faces))


def rounded_box(size: Vector, divisions: int, power: float = 4.0) -> Polygons:
    """A superellipsoid of the given extents, as six patches of a cube blown up."""
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, divisions + 1))
    a, b = np.meshgrid(t, t, indexing="ij")
    patches = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            p = np.zeros((*a.shape, 3))
            p[..., axis] = sign
            p[..., (axis + 1) % 3], p[..., (axis + 2) % 3] = a * sign, b
            length = (np.abs(p) ** power).sum(axis=-1, keepdims=True) ** (1 / power)
            patches.append(grid(np.swapaxes(p / length, 0, 1) * (np.array(size) / 2)))
    mesh = merged([p.turned() for p in patches])
    normals = unit(np.sign(mesh.points) * np.abs(2 * mesh.points / size) ** (power - 1) / np.array(size))
    return Polygons(mesh.points, normals, mesh.counts, mesh.indices)


def curve(knots: list[tuple[float, float]], x: Floats) -> Floats:
    """A smooth curve through (x, y) knots in ascending x: cubics with the slopes of Catmull and Rom."""
    kx, ky = np.array(knots).T
    slopes = np.gradient(ky, kx)
    i = np.clip(np.searchsorted(kx, x) - 1, 0, len(kx) - 2)
    width = kx[i + 1] - kx[i]
    t = np.clip((x - kx[i]) / width, 0, 1)
    return (
        ky[i] * (1 + 2 * t) * (1 - t) ** 2
        + slopes[i] * width * t * (1 - t) ** 2
        + ky[i + 1] * t * t * (3 - 2 * t)
        + slopes[i + 1] * width * t * t * (t - 1)
    )


def smoothstep(low: float, high: float, x: Floats) -> Floats:
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def polygon_distance(corners: ArrayLike, x: Floats, y: Floats) -> Floats:
    """Signed distance to a polygon in the plane, positive inside."""
    p = np.asarray(corners, float)
    q = np.roll(p, -1, axis=0)
    nearest = np.full(x.shape, np.inf)
    inside = np.zeros(x.shape, bool)
    for (ax, ay), (bx, by) in zip(p, q, strict=True):
        ex, ey = bx - ax, by - ay
        t = np.clip(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey), 0, 1)
        nearest = np.minimum(nearest, np.hypot(x - ax - t * ex, y - ay - t * ey))
        if ey != 0:
            inside ^= ((ay > y) != (by > y)) & (x < (y - ay) / ey * ex + ax)
    return np.where(inside, nearest, -nearest)


# --- USD ------------------------------------------------------------------------------------------


def new_stage(comment: str, settings: dict[str, float]) -> Usd.Stage:
    """settings: recorded in customLayerData["encore"], by the names of docs/settings.md."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.comment = comment
    layer.customLayerData = {"encore": settings}
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def add_mesh(
    stage: Usd.Stage,
    path: str,
    mesh: Polygons,
    look: UsdShade.Material | None = None,
    *,
    smooth: bool = True,
) -> UsdGeom.Mesh:
    mesh = mesh.compact()
    prim = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.points, np.float32))
    prim.CreatePointsAttr(points)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.counts.astype(np.int32)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.indices.astype(np.int32)))
    prim.CreateSubdivisionSchemeAttr("none")
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    if smooth:
        prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.normals, np.float32)))
        prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if look:
        UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(look)
    return prim


def add_texture_coordinates(mesh: UsdGeom.Mesh, st: ArrayLike, interpolation: str = "vertex") -> None:
    """st: one pair per point, or per face corner where interpolation is faceVarying."""
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    primvar.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(st, np.float32)))


def add_material(
    stage: Usd.Stage, name: str, texture: str = "", **inputs: float | Vector
) -> UsdShade.Material:
    """A UsdPreviewSurface; texture: asset path of its diffuse colour, by the primvar st."""
    result = UsdShade.Material.Define(stage, f"/World/Looks/{name}")
    surface = UsdShade.Shader.Define(stage, result.GetPath().AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    for key, value in inputs.items():
        kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
        surface.CreateInput(key, kind).Set(value)
    if texture:
        image = add_image(stage, result, "Image", texture, color_space="sRGB", wrap="repeat")
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
            image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        )
    result.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return result


def add_image(
    stage: Usd.Stage,
    material: UsdShade.Material,
    name: str,
    file: str,
    *,
    color_space: str,
    wrap: str,
    scale: float = 1.0,
) -> UsdShade.Shader:
    """A UsdUVTexture of a material, by the primvar st."""
    path = material.GetPath()
    reader = UsdShade.Shader.Define(stage, path.AppendChild("St"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image = UsdShade.Shader.Define(stage, path.AppendChild(name))
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    for direction in ("wrapS", "wrapT"):
        image.CreateInput(direction, Sdf.ValueTypeNames.Token).Set(wrap)
    if scale != 1:
        image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(scale, scale, scale, 1))
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    )
    return image


def looking_at(eye: Vector, target: Vector) -> Gf.Matrix4d:
    return Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(0, 1, 0)).GetInverse()


def add_camera(stage: Usd.Stage, eye: Vector, target: Vector, focal_mm: float, aspect: float) -> None:
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(focal_mm)
    camera.CreateHorizontalApertureAttr(36.0)
    camera.CreateVerticalApertureAttr(36.0 / aspect)
    camera.CreateClippingRangeAttr((0.05, 1000))
    camera.AddTransformOp().Set(looking_at(eye, target))


def add_softbox(
    stage: Usd.Stage,
    name: str,
    eye: Vector,
    target: Vector,
    size: tuple[float, float],
    intensity: float,
    color: Vector = (1, 1, 1),
) -> None:
    light = UsdLux.RectLight.Define(stage, f"/World/Lights/{name}")
    light.CreateWidthAttr(size[0])
    light.CreateHeightAttr(size[1])
    light.CreateIntensityAttr(intensity)
    light.CreateColorAttr(color)
    # Straight down has no horizon to be upright by.
    nudge = 1e-3 if eye[0] == target[0] and eye[2] == target[2] else 0.0
    light.AddTransformOp().Set(looking_at(eye, (target[0], target[1], target[2] - nudge)))


def add_dome(stage: Usd.Stage, intensity: float, color: Vector) -> None:
    dome = UsdLux.DomeLight.Define(stage, "/World/Lights/Sky")
    dome.CreateIntensityAttr(intensity)
    dome.CreateColorAttr(color)


def write_png(path: Path, pixels: Floats) -> None:
    """8-bit sRGB as given: (height, width, 3) of 0 to 1."""
    values = np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8)
    height, width = values.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), values.reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        checked = kind + data
        return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows.tobytes(), 6))
        + chunk(b"IEND", b"")
    )


def run(description: str, default: str, make: Callable[[Path, bool], Usd.Stage]) -> None:
    """The command line of a generator. make: of the stage's file, beside which textures go, and --quick."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("output", nargs="?", type=Path, default=Path(default), help=f"({default})")
    parser.add_argument("--quick", action="store_true", help="fewer faces, and settings of a small frame")
    arguments = parser.parse_args()
    if arguments.output.suffix not in (".usd", ".usda", ".usdc"):
        parser.error("the output must end in .usda, .usdc or .usd")
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    stage = make(arguments.output, arguments.quick)
    stage.GetRootLayer().Export(str(arguments.output))
    print(f"{arguments.output}: {primitives(stage)} polygons; render with {flags(stage)}")


def primitives(stage: Usd.Stage) -> int:
    """Faces of all meshes, instances counted each."""
    prims = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    return sum(len(UsdGeom.Mesh(p).GetFaceVertexCountsAttr().Get()) for p in prims if p.IsA(UsdGeom.Mesh))


def flags(stage: Usd.Stage) -> str:
    """The recorded settings as flags of `encore record`."""
    names = {"width": "imageWidth", "height": "imageHeight", "max_bounces": "maxBounces"}
    names |= {"shading_rate": "shadingRate", "samples": "samples"}
    settings = stage.GetRootLayer().customLayerData["encore"]
    return " ".join(f"--{names[key]} {value:g}" for key, value in settings.items())
