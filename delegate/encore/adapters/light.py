"""UsdLux lights → radiance, world-space shape, shaping and shadows, after the schema's own formulas."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux

from encore.adapters.context import Matrix, SyncContext, floats, number_of
from encore.adapters.texture import Textures

Colour = tuple[float, float, float]

# UsdLux type → core's kind.
TYPES = {
    "DistantLight": "distant",
    "RectLight": "rect",
    "DiskLight": "disk",
    "SphereLight": "sphere",
    "CylinderLight": "cylinder",
    "DomeLight": "dome",
    "DomeLight_1": "dome",
}
# Rays per shade; there is no such thing in UsdLux.
SAMPLES = "encore:samples"
_MOST_SAMPLES = 65536  # as --lightSamples
# Angles below this, in degrees, make no penumbra that floating point could tell.
_SMALLEST_ANGLE_DEGREES = 1e-4
# In world units; below it the square of the area, in core's single precision, would be 0.
_SMALLEST_AREA = 1e-17
_FORMATS = ("latlong", "mirroredBall", "angular", "cubeMapVerticalCross")
# Relative differences of stretches that are not seen.
_ROUND = 0.99


@dataclass(frozen=True)
class LightData:
    """One light as _core.Scene.add_light takes it."""

    kind: str
    path: str
    radiance: Colour
    shape: dict[str, Any] = field(default_factory=dict)

    @property
    def texture(self) -> int:
        """Of Textures; -1: none."""
        return int(self.shape.get("texture", -1))

    def arguments(self, texture: int) -> dict[str, Any]:
        """Keyword arguments of _core.Scene.add_light. texture: the scene's."""
        shape = self.shape | {"texture": texture} if self.texture >= 0 else self.shape
        return {"kind": self.kind, "path": self.path, "radiance": self.radiance, **shape}


@dataclass(frozen=True)
class Shape:
    """Arguments of add_light, and the size by which `normalize` divides: 0 where there is nothing to emit.

    finite: it is at a finite distance, so that shaping means something. flat: it emits to one side.
    """

    arguments: dict[str, Any]
    size: float
    finite: bool = True
    flat: bool = False


def read_light(
    prim: Usd.Prim, to_world: Matrix, path: str, textures: Textures, context: SyncContext
) -> LightData | None:
    """A light of TYPES at a place; None, and a report, where it cannot emit.

    path: the prim's, or that of its instance.
    """
    kind = TYPES[prim.GetTypeName()]
    finite = np.isfinite(to_world).all()
    shape = _SHAPES[kind](prim, to_world, context) if finite else Shape({}, 0.0)
    mirrored = bool(shape.size > 0 and np.linalg.det(to_world[:3, :3]) < 0)
    texture = _texture(prim, mirrored, textures, context) if shape.size > 0 else {}
    return make_light(prim, kind, to_world, path, shape, texture, context)


def camera_light(direction: Colour) -> LightData:
    """What lights a stage without lights: parallel, along the view. White diffuse surfaces that face the
    camera appear white.
    """
    return LightData("distant", "cameraLight", (math.pi,) * 3, {"direction": direction})


def make_light(
    prim: Usd.Prim,
    kind: str,
    to_world: Matrix,
    path: str,
    shape: Shape,
    texture: dict[str, Any],
    context: SyncContext,
) -> LightData | None:
    """A light of a shape; None, and a report, where it cannot emit. texture: arguments of its image."""
    light = UsdLux.LightAPI(prim)
    radiance = _radiance(light, shape.size, context)
    multipliers = floats(
        (light.GetDiffuseAttr().Get(context.time), light.GetSpecularAttr().Get(context.time)), 2
    )
    if shape.size == 0 or radiance is None or multipliers is None:
        what = (
            "its size is 0 or not finite, or its transform is singular"
            if shape.size == 0
            else "its colour or intensity is not finite"
        )
        context.reports.error("bad light", f"is not rendered: {what}", prim.GetPath())
        return None
    _report_unsupported(prim, kind, context)
    arguments = shape.arguments | texture | {"diffuse": multipliers[0], "specular": multipliers[1]}
    arguments |= _shaping(prim, to_world, shape, context) | _shadow(prim, context) | _samples(prim, context)
    return LightData(kind, path, radiance, arguments)


def _radiance(light: UsdLux.LightAPI, size: float, context: SyncContext) -> Colour | None:
    """UsdLuxLightAPI's emission: intensity · 2^exposure · colour · temperature, over size where normalized.

    Irradiance for a distant light of angle 0. size: area, or projected solid angle of a distant light's disk.
    """
    time = context.time
    intensity, exposure = light.GetIntensityAttr().Get(time), light.GetExposureAttr().Get(time)
    colour = floats(light.GetColorAttr().Get(time), 3)
    if colour is None or floats((intensity, exposure), 2) is None or not size:
        return None
    if light.GetEnableColorTemperatureAttr().Get(time):
        kelvin = float(light.GetColorTemperatureAttr().Get(time))
        if not math.isfinite(kelvin):
            return None
        tint = UsdLux.BlackbodyTemperatureAsRgb(kelvin)
        colour = tuple(c * float(t) for c, t in zip(colour, tint, strict=True))
    try:
        scale = intensity * 2.0**exposure / (size if light.GetNormalizeAttr().Get(time) else 1.0)
    except OverflowError:
        return None
    red, green, blue = (c * scale for c in colour)
    largest = max(abs(red), abs(green), abs(blue))
    return (red, green, blue) if largest <= float(np.finfo(np.float32).max) else None


# Shapes


def _distant(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> Shape:
    direction = -to_world[2, :3]
    length = float(np.linalg.norm(direction))
    degrees = number_of(UsdLux.DistantLight(prim).GetAngleAttr(), context.time)
    if not (length > 0 and math.isfinite(length) and math.isfinite(degrees)):
        return Shape({}, 0.0)
    angle = math.radians(min(max(degrees, 0.0), 360.0))
    arguments = {"direction": _triple(direction / length), "angle_radians": angle}
    if degrees < _SMALLEST_ANGLE_DEGREES:
        return Shape(arguments | {"angle_radians": 0.0}, 1.0, finite=False)
    # Integral of the cosine over the disk, on a surface that faces its centre (UsdLuxLightAPI, normalize).
    sin2 = math.sin(angle / 2) ** 2
    return Shape(arguments, math.pi * (sin2 if angle <= math.pi else 2 - sin2), finite=False)


def _rect(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> Shape:
    light = UsdLux.RectLight(prim)
    width = max(number_of(light.GetWidthAttr(), context.time), 0.0)
    height = max(number_of(light.GetHeightAttr(), context.time), 0.0)
    return _flat(to_world[0, :3] * (width / 2), to_world[1, :3] * (height / 2), to_world, 4.0)


def _disk(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> Shape:
    radius = max(number_of(UsdLux.DiskLight(prim).GetRadiusAttr(), context.time), 0.0)
    return _flat(to_world[0, :3] * radius, to_world[1, :3] * radius, to_world, math.pi)


def _flat(u: Matrix, v: Matrix, to_world: Matrix, factor: float) -> Shape:
    """What spans u and v, and emits towards its own -Z. factor: of its area."""
    if np.linalg.det(to_world[:3, :3]) < 0:
        u = -u  # keeps the emitting side where the transform takes it
    area = factor * float(np.linalg.norm(np.cross(u, v)))
    arguments = {"centre": _triple(to_world[3, :3]), "half_u": _triple(u), "half_v": _triple(v)}
    return Shape(arguments, _finite(area), flat=True)


def _sphere(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> Shape:
    linear = to_world[:3, :3]
    scale = abs(float(np.linalg.det(linear))) ** (1 / 3)
    stretches = np.linalg.svd(linear, compute_uv=False)
    if stretches.min() < _ROUND * stretches.max():
        context.reports.add(
            "stretched SphereLight",
            "is rendered as a sphere of equal volume, not as an ellipsoid",
            prim.GetPath(),
        )
    light = UsdLux.SphereLight(prim)
    radius = scale * number_of(light.GetRadiusAttr(), context.time)
    _report_hint(prim, "treatAsPoint", "a sphere", context)
    area = 4 * math.pi * radius * abs(radius)
    return Shape({"centre": _triple(to_world[3, :3]), "radius": radius}, _finite(area))


def _cylinder(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> Shape:
    light = UsdLux.CylinderLight(prim)
    axis, y, z = to_world[:3, :3]
    half = axis * (number_of(light.GetLengthAttr(), context.time) / 2)
    # The cross section, seen along the axis; a round one of equal area.
    stretches: Matrix = np.zeros(2)
    length = float(np.linalg.norm(axis))
    if length > 0:
        across = np.stack([y, z]) @ (np.eye(3) - np.outer(axis, axis) / length**2)
        stretches = np.asarray(np.linalg.svd(across, compute_uv=False), np.float64)
    leans = abs(float(axis @ y)) + abs(float(axis @ z)) > 0.01 * length * float(np.linalg.norm([y, z]))
    if stretches.min() < _ROUND * stretches.max() or leans:
        context.reports.add(
            "stretched CylinderLight",
            "is rendered as a round cylinder of equal cross section, not as an elliptic or leaning one",
            prim.GetPath(),
        )
    radius = math.sqrt(float(stretches.prod())) * number_of(light.GetRadiusAttr(), context.time)
    _report_hint(prim, "treatAsLine", "a cylinder", context)
    area = 4 * math.pi * radius * float(np.linalg.norm(half))
    positive = number_of(light.GetLengthAttr(), context.time) > 0
    arguments = {"centre": _triple(to_world[3, :3]), "half_u": _triple(half), "radius": radius}
    return Shape(arguments, _finite(area) if positive else 0.0)


def _dome(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> Shape:
    """Its axes, in which the top of an image is at +Y and its middle at +Z.

    With the pole at Z its top is at the prim's +Z and its middle at -Y (UsdLuxDomeLight_1).
    """
    x, y, z = to_world[:3, :3]
    axes = np.stack([x, y, z])
    if prim.IsA(UsdLux.DomeLight_1):
        pole = UsdLux.DomeLight_1(prim).GetPoleAxisAttr().Get()
        if pole == "scene":
            pole = UsdGeom.GetStageUpAxis(context.stage)
        if pole == UsdGeom.Tokens.z:
            axes = np.stack([x, z, -y])
    rotation = _orthonormal(axes)
    if rotation is None:
        return Shape({}, 0.0)
    sizes = np.linalg.svd(axes, compute_uv=False)
    if sizes.min() < _ROUND * sizes.max() or np.linalg.det(axes) < 0:
        context.reports.add(
            "stretched DomeLight",
            "is only rotated: its scale, shear and mirroring are left out",
            prim.GetPath(),
        )
    names = ("axis_x", "axis_y", "axis_z")
    return Shape({n: _triple(a) for n, a in zip(names, rotation, strict=True)}, 1.0, finite=False)


_SHAPES: dict[str, Callable[[Usd.Prim, Matrix, SyncContext], Shape]] = {
    "distant": _distant,
    "rect": _rect,
    "disk": _disk,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "dome": _dome,
}


def _orthonormal(axes: Matrix) -> Matrix | None:
    """The nearest rotation to three axes; None where they are singular."""
    u, sizes, v = np.linalg.svd(axes)
    if not sizes[-1] > 1e-12 * sizes[0]:
        return None
    if np.linalg.det(u @ v) < 0:
        u = u * (1, 1, -1)
    rotation: Matrix = u @ v
    return rotation


def _triple(vector: Matrix) -> Colour:
    x, y, z = (float(value) for value in vector)
    return x, y, z


def _finite(size: float) -> float:
    return size if math.isfinite(size) and size > _SMALLEST_AREA else 0.0


# Controls


def _texture(prim: Usd.Prim, mirrored: bool, textures: Textures, context: SyncContext) -> dict[str, Any]:
    """The image of a rect or dome, where there is one. One that cannot be read leaves the plain colour."""
    attribute = prim.GetAttribute("inputs:texture:file")
    asset = attribute.Get(context.time) if attribute else None
    if not isinstance(asset, Sdf.AssetPath) or not asset.path:
        return {}
    source = attribute.GetColorSpace() if attribute.HasColorSpace() else "auto"
    index = textures.light_texture(asset, source, prim.GetPath())
    if index < 0:
        return {}
    if mirrored and prim.GetTypeName() == "RectLight":
        context.reports.add(
            "mirrored light texture", "its transform mirrors: its texture is not mirrored", prim.GetPath()
        )
    form = prim.GetAttribute("inputs:texture:format")
    name = str(form.Get(context.time)) if form else "latlong"
    if name not in (*_FORMATS, "automatic"):
        context.reports.error("bad texture:format", f"{name} is no format: latlong is used", prim.GetPath())
    return {"texture": index, "format": name if name in _FORMATS else "latlong"}


def _reader(prim: Usd.Prim, schema: Any, context: SyncContext) -> Callable[[str, Any], Any]:
    """Reads inputs of an API schema: authored ones, and where it is applied its fallbacks; else `neutral`."""
    applied = prim.HasAPI(schema)

    def read(name: str, neutral: Any) -> Any:
        attribute = prim.GetAttribute(f"inputs:{name}")
        if not attribute or not (applied or attribute.HasAuthoredValue()):
            return neutral
        value = attribute.Get(context.time)
        if value is None:
            return neutral
        if not isinstance(value, bool) and floats(value, np.size(neutral)) is None:
            context.reports.error(f"bad {name}", f"inputs:{name} is {value}, and is ignored", prim.GetPath())
            return neutral
        return value

    return read


def _shaping(prim: Usd.Prim, to_world: Matrix, shape: Shape, context: SyncContext) -> dict[str, Any]:
    """Cone and focus, where they change anything."""
    read = _reader(prim, UsdLux.ShapingAPI, context)
    angle = min(max(float(read("shaping:cone:angle", 180.0)), 0.0), 180.0)
    softness = min(max(float(read("shaping:cone:softness", 0.0)), 0.0), 1.0)
    focus = max(float(read("shaping:focus", 0.0)), 0.0)
    tint = floats(read("shaping:focusTint", (0.0, 0.0, 0.0)), 3)
    wide = 90.0 if shape.flat else 180.0
    if angle >= wide and softness == 0 and (focus == 0 or tint == (1.0, 1.0, 1.0)):
        return {}
    axis = -to_world[2, :3]
    if not shape.finite:
        if (angle < 180 and angle != 90) or focus > 0:
            context.reports.add(
                "shaping of a distant light",
                "cone and focus have no effect on lights at infinite distance",
                prim.GetPath(),
            )
        return {}
    length = float(np.linalg.norm(axis))
    if not length > 0:
        return {}
    return {
        "shaped": True,
        "shaping_axis": _triple(axis / length),
        "focus": focus,
        "focus_tint": tint,
        "cone_angle_radians": math.radians(angle),
        "cone_softness": softness,
    }


def _shadow(prim: Usd.Prim, context: SyncContext) -> dict[str, Any]:
    """What UsdLuxShadowAPI says, where it differs from plain shadows."""
    read = _reader(prim, UsdLux.ShadowAPI, context)
    enable = bool(read("shadow:enable", True))
    colour = floats(read("shadow:color", (0.0, 0.0, 0.0)), 3)
    distance = float(read("shadow:distance", -1.0))
    falloff = float(read("shadow:falloff", -1.0))
    gamma = float(read("shadow:falloffGamma", 1.0))
    found: dict[str, Any] = {}
    if not enable:
        found["shadow_enable"] = False
    if colour != (0.0, 0.0, 0.0):
        found["shadow_color"] = colour
    if distance >= 0:
        found["shadow_distance"] = distance
        if falloff > 0:
            # The zone is within the distance (UsdLuxShadowAPI).
            found |= {"shadow_falloff": min(falloff, distance), "shadow_falloff_gamma": max(gamma, 0.0)}
    return found


def _samples(prim: Usd.Prim, context: SyncContext) -> dict[str, Any]:
    attribute = prim.GetAttribute(SAMPLES)
    value = attribute.Get(context.time) if attribute else None
    if value is None or value == 0:
        return {}
    if not isinstance(value, int) or not 0 < value <= _MOST_SAMPLES:
        context.reports.error(
            f"bad {SAMPLES}",
            f"{SAMPLES} is {value}, not a whole number from 0 to {_MOST_SAMPLES}: the settings decide",
            prim.GetPath(),
        )
        return {}
    return {"samples": value}


def _report_hint(prim: Usd.Prim, name: str, what: str, context: SyncContext) -> None:
    attribute = prim.GetAttribute(name)
    if attribute and attribute.Get(context.time):
        context.reports.note(name, f"is rendered as {what} all the same, at its full size", prim.GetPath())


def _report_unsupported(prim: Usd.Prim, kind: str, context: SyncContext) -> None:
    """Reports what a light asks for and does not get."""
    path, reports = prim.GetPath(), context.reports
    profile = prim.GetAttribute("inputs:shaping:ies:file")
    value = profile.Get(context.time) if profile else None
    if isinstance(value, Sdf.AssetPath) and value.path:
        reports.add("light shaping:ies:file", "IES profiles are not supported: its shape is left out", path)
    filters = prim.GetRelationship("light:filters")
    if filters and filters.GetTargets():
        reports.add("light filters", "light filters are not supported: it is not filtered", path)
    portals = prim.GetRelationship("portals")
    if portals and portals.GetTargets():
        reports.note("portals", "portals are not needed, and not used", path)
