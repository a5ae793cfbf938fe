"""One still scene twice: as a USD stage, and for Mitsuba 3 with an integrator of the same transport.

Paths end at the first diffuse surface, which is lit by one sample of an emitter per hit; mirrors and glass
are followed. Nothing of it is shared with core but the arrays of the geometry.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdLux, UsdShade
from rendering import (
    CUBE,
    CUBE_FACES,
    add_camera,
    add_image,
    add_material,
    add_mesh,
    add_texcoords,
    connect,
    new_stage,
    write_exr,
)

WIDTH, HEIGHT = 64, 48
EYE, TARGET, HALF_TANGENT = (0.6, 1.7, 4.2), (0.0, 0.55, 0.0), 0.42
LIGHT_SIZE, LIGHT_HEIGHT, LIGHT_RADIANCE = 1.2, 2.6, (11.0, 10.0, 8.0)
COPPER, COPPER_ROUGHNESS, IOR, MAX_BOUNCES = (0.86, 0.5, 0.32), 0.28, 1.5, 5


def sky() -> np.ndarray:
    """A latlong image with a bright patch, (256, 512, 3).

    Fine, since Mitsuba has its first and last row at the poles themselves, and USD half a pixel away.
    """
    y, x = (np.mgrid[0:256, 0:512] + 0.5) / 256
    up = np.cos(np.pi * y)
    blue = np.stack([0.25 + 0.1 * up, 0.3 + 0.15 * up, 0.4 + 0.25 * up], axis=-1)
    patch = np.exp(-(((x - 0.55) / 0.22) ** 2) - ((y - 0.36) / 0.16) ** 2)
    return (blue + patch[..., None] * (5.0, 4.2, 3.0)).astype(np.float32)


def tiles() -> np.ndarray:
    """The floor's albedo, linear: soft waves of two colours. (64, 64, 3)"""
    y, x = (np.mgrid[0:64, 0:64] + 0.5) / 64
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * x) * np.sin(2 * np.pi * y)
    return (wave[..., None] * (0.7, 0.65, 0.5) + (1 - wave[..., None]) * (0.1, 0.15, 0.3)).astype(np.float32)


def ball(radius: float, centre: tuple[float, float, float]) -> tuple[np.ndarray, list[list[int]]]:
    """A faceted sphere of triangles, its poles single points."""
    rows, columns = 24, 48
    polar, turn = np.pi * np.arange(1, rows) / rows, 2 * np.pi * np.arange(columns) / columns
    ring = [(np.sin(a) * np.cos(b), np.cos(a), -np.sin(a) * np.sin(b)) for a in polar for b in turn]
    points = np.array([*ring, (0, 1, 0), (0, -1, 0)]) * radius + centre
    top, bottom = len(ring), len(ring) + 1
    faces = []
    for j in range(columns):
        k = (j + 1) % columns
        faces += [[top, j, k], [bottom, (rows - 2) * columns + k, (rows - 2) * columns + j]]
        for i in range(rows - 2):
            a, b, c, d = i * columns + j, (i + 1) * columns + j, (i + 1) * columns + k, i * columns + k
            faces += [[a, b, c], [a, c, d]]
    return points, faces


def turned_box(
    size: float, centre: tuple[float, float, float], degrees: float
) -> tuple[np.ndarray, list[list[int]]]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    points = np.array(CUBE) * size @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + centre
    return points, [t for a, b, c, d in CUBE_FACES for t in ([a, b, c], [a, c, d])]


FLOOR = (np.array([(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], float), [[0, 1, 2], [0, 2, 3]])
FLOOR_ST = np.array([(0, 0), (2, 0), (2, 2), (0, 2)], float)
OBJECTS = {
    "Copper": ball(0.6, (-0.75, 0.61, -0.2)),
    "Glass": turned_box(0.8, (0.75, 0.42, 0.3), 28.0),
}


def usd_stage(folder: Path) -> Usd.Stage:
    write_exr(folder / "sky.exr", sky())
    write_exr(folder / "tiles.exr", tiles())
    stage = new_stage()
    copper = add_material(stage, "Copper", diffuseColor=COPPER, metallic=1.0, roughness=COPPER_ROUGHNESS)
    glass = add_material(stage, "Glass", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=IOR, roughness=0.0)
    for name, look in (("Copper", copper), ("Glass", glass)):
        add_mesh(stage, f"/World/{name}", *OBJECTS[name], look)
    floor = add_mesh(stage, "/World/Floor", *FLOOR, _textured(stage, str(folder / "tiles.exr")))
    add_texcoords(floor, FLOOR_ST)
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateWidthAttr(LIGHT_SIZE)
    light.CreateHeightAttr(LIGHT_SIZE)
    light.CreateIntensityAttr(1.0)
    light.CreateColorAttr(LIGHT_RADIANCE)
    light.AddTranslateOp().Set((0, LIGHT_HEIGHT, 0))
    light.AddRotateXOp().Set(-90)
    dome = UsdLux.DomeLight.Define(stage, "/World/Sky")
    dome.CreateTextureFileAttr(str(folder / "sky.exr"))
    camera = add_camera(stage, EYE, TARGET, HALF_TANGENT)
    camera.GetVerticalApertureAttr().Set(20.0 * HALF_TANGENT * HEIGHT / WIDTH)
    return stage


def _textured(stage: Usd.Stage, file: str) -> UsdShade.Material:
    look = add_material(stage, "Tiles", roughness=1.0)
    connect(look, "diffuseColor", add_image(look, "Image", file), "rgb", Sdf.ValueTypeNames.Color3f)
    return look


def render_mitsuba(mi: Any, samples: int, seed: int) -> dict[str, np.ndarray]:
    """Layers by name, (HEIGHT, WIDTH, 3) each, box filtered. mi: mitsuba with an llvm variant."""
    import drjit as dr

    def mesh(name: str, bsdf: dict[str, Any], arrays: Any, st: np.ndarray | None = None) -> Any:
        points, faces = arrays
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(bsdf)
        made = mi.Mesh(name, len(points), len(faces), has_vertex_texcoords=st is not None, props=properties)
        parameters = mi.traverse(made)
        parameters["vertex_positions"] = np.asarray(points, np.float32).ravel()
        parameters["faces"] = np.asarray(faces, np.uint32).ravel()
        if st is not None:
            parameters["vertex_texcoords"] = np.asarray(st, np.float32).ravel()
        parameters.update()
        return made

    def bitmap(pixels: np.ndarray) -> Any:
        return mi.Bitmap(np.ascontiguousarray(pixels))

    # Its images begin at t = 0 with their first row, those of USD with their last.
    albedo = {"type": "bitmap", "bitmap": bitmap(tiles()), "raw": True, "wrap_mode": "repeat"}
    side = LIGHT_SIZE / 2
    copper = {
        "type": "principled",
        "base_color": {"type": "rgb", "value": list(COPPER)},
        "metallic": 1.0,
        "roughness": COPPER_ROUGHNESS,
        "specular": 0.5,
    }
    objects = {
        "floor": mesh("floor", {"type": "diffuse", "reflectance": albedo}, FLOOR, FLOOR_ST * (1, -1)),
        "copper": mesh("copper", copper, OBJECTS["Copper"]),
        "glass": mesh("glass", {"type": "dielectric", "int_ior": IOR, "ext_ior": 1.0}, OBJECTS["Glass"]),
    }
    occluders = mi.load_dict({"type": "scene", **objects})  # lights cast no shadows
    scene = mi.load_dict(
        {
            "type": "scene",
            **objects,
            "light": {
                "type": "rectangle",
                # Faces +z as it is made.
                "to_world": mi.ScalarTransform4f()
                .translate([0, LIGHT_HEIGHT, 0])
                .rotate([1, 0, 0], 90)
                .scale([side, side, 1]),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(LIGHT_RADIANCE)}},
            },
            "sky": {"type": "envmap", "bitmap": bitmap(sky())},
            "sensor": {
                "type": "perspective",
                "fov_axis": "x",
                "fov": float(np.degrees(2 * np.arctan(HALF_TANGENT))),
                "to_world": mi.ScalarTransform4f().look_at(origin=EYE, target=TARGET, up=[0, 1, 0]),
                "film": {
                    "type": "hdrfilm",
                    "width": WIDTH,
                    "height": HEIGHT,
                    "rfilter": {"type": "box"},
                    "component_format": "float32",
                },
                "sampler": {"type": "independent", "sample_count": samples},
            },
        }
    )

    class FirstDiffuse(mi.SamplingIntegrator):  # type: ignore[misc, name-defined]
        """layer: 0 direct, 1 reflection, 2 refraction."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.layer = props.get("layer", 0)

        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            ray = mi.Ray3f(ray)
            active = mi.Bool(active)
            throughput, result = mi.Spectrum(1), mi.Spectrum(0)
            context = mi.BSDFContext()
            for bounce in range(MAX_BOUNCES + 1):
                hit = scene.ray_intersect(ray, active)
                emitter = hit.emitter(scene, active)
                met = active & (emitter != None)  # noqa: E711
                of_layer = (self.layer == 0) if bounce == 0 else True
                if of_layer:
                    result += dr.select(met, throughput * emitter.eval(hit, met), 0)
                # A light hides what is behind it, and is seen from its other side as nothing.
                active &= hit.is_valid() & ~met
                bsdf = hit.bsdf(ray)
                diffuse = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.DiffuseReflection)
                diffuse &= ~mi.has_flag(bsdf.flags(), mi.BSDFFlags.GlossyReflection)
                light, weight = scene.sample_emitter_direction(hit, sampler.next_2d(), False, diffuse)
                shadow = hit.spawn_ray_to(light.p)
                weight = dr.select(occluders.ray_test(shadow, diffuse), 0, weight)
                value = bsdf.eval(context, hit, hit.to_local(light.d), diffuse)
                if of_layer:
                    result += dr.select(diffuse, throughput * value * weight, 0)
                active &= ~diffuse
                if bounce == MAX_BOUNCES or self.layer == 0:
                    break
                chosen, weight = bsdf.sample(
                    context, hit, sampler.next_1d(active), sampler.next_2d(active), active
                )
                throughput *= dr.select(active, weight, 0)
                if bounce == 0 and self.layer > 0:
                    crosses = chosen.wo.z * mi.Frame3f.cos_theta(hit.wi) < 0
                    active &= crosses if self.layer == 2 else ~crosses
                ray = hit.spawn_ray(hit.to_world(chosen.wo))
            return result, mi.Bool(True), []

    mi.register_integrator("first_diffuse", lambda props: FirstDiffuse(props))
    layers = {}
    for number, name in enumerate(("direct", "reflection", "refraction")):
        integrator = mi.load_dict({"type": "first_diffuse", "layer": number})
        layers[name] = np.array(mi.render(scene, integrator=integrator, spp=samples, seed=seed))[..., :3]
    return layers
