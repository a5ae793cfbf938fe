"""UsdLux lights → radiance and world-space shape."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Usd, UsdLux

from encore.adapters.context import Matrix, SyncContext, floats

Colour = tuple[float, float, float]

# UsdLux type → core's kind.
TYPES = {
    "DistantLight": "distant",
    "RectLight": "rect",
    "SphereLight": "sphere",
    "DomeLight": "dome",
    "DomeLight_1": "dome",
}
# Angles below this, in degrees, make no penumbra that floating point could tell.
_SMALLEST_ANGLE_DEGREES = 1e-4


@dataclass(frozen=True)
class LightData:
    """One light as _core.Scene.add_light takes it."""

    kind: str
    path: str
    radiance: Colour
    shape: dict[str, Any] = field(default_factory=dict)

    def arguments(self) -> dict[str, Any]:
        return {"kind": self.kind, "path": self.path, "radiance": self.radiance, **self.shape}


def read_light(prim: Usd.Prim, to_world: Matrix, path: str, context: SyncContext) -> LightData | None:
    """A light of TYPES at a place; None, and a report, where it cannot emit.

    path: the prim's, or that of its instance.
    """
    kind = TYPES[prim.GetTypeName()]
    shape, size = _SHAPES[kind](prim, to_world, context)
    radiance = _radiance(UsdLux.LightAPI(prim), size, context)
    if size == 0 or radiance is None:
        what = "its size is 0 or not finite" if size == 0 else "its colour or intensity is not finite"
        context.reports.error("bad light", f"is not rendered: {what}", prim.GetPath())
        return None
    _report_unsupported(prim, kind, context)
    light = UsdLux.LightAPI(prim)
    shape["diffuse"] = float(light.GetDiffuseAttr().Get(context.time))
    shape["specular"] = float(light.GetSpecularAttr().Get(context.time))
    return LightData(kind, path, radiance, shape)


def camera_light(direction: Colour) -> LightData:
    """What lights a stage without lights: parallel, along the view. White diffuse surfaces that face the
    camera appear white.
    """
    return LightData("distant", "cameraLight", (math.pi,) * 3, {"direction": direction})


def _radiance(light: UsdLux.LightAPI, size: float, context: SyncContext) -> Colour | None:
    """UsdLuxLightAPI's emission: intensity · 2^exposure · colour · temperature, over size where normalized.

    Irradiance for a distant light of angle 0. size: area, or projected solid angle of a distant light's disk.
    """
    time = context.time
    scale = float(light.GetIntensityAttr().Get(time)) * 2.0 ** float(light.GetExposureAttr().Get(time))
    colour = floats(light.GetColorAttr().Get(time), 3)
    if colour is None or not math.isfinite(scale) or not size:
        return None
    if light.GetEnableColorTemperatureAttr().Get(time):
        tint = UsdLux.BlackbodyTemperatureAsRgb(light.GetColorTemperatureAttr().Get(time))
        colour = tuple(c * float(t) for c, t in zip(colour, tint, strict=True))
    if light.GetNormalizeAttr().Get(time):
        scale /= size
    red, green, blue = (c * scale for c in colour)
    return red, green, blue


def _distant(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> tuple[dict[str, Any], float]:
    direction = -to_world[2, :3]
    length = float(np.linalg.norm(direction))
    degrees = float(UsdLux.DistantLight(prim).GetAngleAttr().Get(context.time))
    if not (length > 0 and math.isfinite(length) and math.isfinite(degrees)):
        return {}, 0.0
    angle = math.radians(min(max(degrees, 0.0), 360.0))
    shape = {"direction": tuple(float(x) for x in direction / length), "angle_radians": angle}
    if degrees < _SMALLEST_ANGLE_DEGREES:
        shape["angle_radians"] = 0.0
        return shape, 1.0
    # Integral of the cosine over the disk, on a surface that faces its centre (UsdLuxDistantLight).
    sin2 = math.sin(angle / 2) ** 2
    return shape, math.pi * (sin2 if angle <= math.pi else 2 - sin2)


def _rect(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> tuple[dict[str, Any], float]:
    light = UsdLux.RectLight(prim)
    u = to_world[0, :3] * (float(light.GetWidthAttr().Get(context.time)) / 2)
    v = to_world[1, :3] * (float(light.GetHeightAttr().Get(context.time)) / 2)
    if np.linalg.det(to_world[:3, :3]) < 0:
        u = -u  # keeps the emitting side, -Z, where the transform takes it
    area = 4 * float(np.linalg.norm(np.cross(u, v)))
    shape = {"centre": tuple(to_world[3, :3]), "half_u": tuple(map(float, u)), "half_v": tuple(map(float, v))}
    return shape, _finite(area)


def _sphere(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> tuple[dict[str, Any], float]:
    linear = to_world[:3, :3]
    scale = abs(float(np.linalg.det(linear))) ** (1 / 3)
    stretches = np.linalg.svd(linear, compute_uv=False) if np.isfinite(linear).all() else np.zeros(3)
    if stretches.min() < 0.99 * stretches.max():
        context.reports.add(
            "stretched SphereLight",
            "is rendered as a sphere of equal volume, not as an ellipsoid",
            prim.GetPath(),
        )
    radius = scale * float(UsdLux.SphereLight(prim).GetRadiusAttr().Get(context.time))
    return {"centre": tuple(to_world[3, :3]), "radius": radius}, _finite(4 * math.pi * radius * abs(radius))


def _dome(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> tuple[dict[str, Any], float]:
    return {}, 1.0


_SHAPES = {"distant": _distant, "rect": _rect, "sphere": _sphere, "dome": _dome}


def _finite(size: float) -> float:
    return size if math.isfinite(size) and size > 0 else 0.0


# Attributes that change nothing yet, with the values at which they would change nothing anyway.
_NEUTRAL: dict[str, tuple[Any, ...]] = {
    "inputs:texture:file": (None,),
    "inputs:shaping:focus": (0.0,),
    "inputs:shaping:cone:angle": (180.0,),
    "inputs:shaping:cone:softness": (0.0,),
    "inputs:shaping:ies:file": (None,),
    "inputs:shadow:enable": (True,),
    "inputs:shadow:color": ((0.0, 0.0, 0.0),),
    "inputs:shadow:distance": (-1.0,),
    "inputs:shadow:falloff": (-1.0,),
}


def _report_unsupported(prim: Usd.Prim, kind: str, context: SyncContext) -> None:
    """Reports what the light's textures, shaping, shadow and linking ask for and do not get."""
    path, reports = prim.GetPath(), context.reports
    for name, neutral in _NEUTRAL.items():
        attribute = prim.GetAttribute(name)
        value = attribute.Get(context.time) if attribute and attribute.HasAuthoredValue() else None
        if value is None or value in neutral or (hasattr(value, "path") and not value.path):
            continue
        if name == "inputs:shaping:cone:angle" and kind == "rect" and value >= 90:
            continue  # wider than what the light emits into
        short = name.removeprefix("inputs:")
        effect = ": only its colour is used" if name.startswith("inputs:texture") else ""
        reports.add(f"light {short}", f"{short} of a {kind} light is not supported yet{effect}", path)
    for collection in ("lightLink", "shadowLink"):
        if _is_restricted(Usd.CollectionAPI(prim, collection)):
            reports.add(
                f"light {collection}", f"{collection} is not supported yet: all prims are linked", path
            )
    if prim.GetRelationship("light:filters").GetTargets():
        reports.add("light filters", "light filters are not supported yet", path)


def _is_restricted(collection: Usd.CollectionAPI) -> bool:
    """True where a linking collection leaves anything out."""
    excludes, includes = collection.GetExcludesRel(), collection.GetIncludesRel()
    include_root = collection.GetIncludeRootAttr()
    return bool(
        (excludes and excludes.GetTargets())
        or (includes and includes.GetTargets() and not (include_root and include_root.Get()))
    )
