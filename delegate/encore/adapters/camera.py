"""Cameras: which one, its film window, and the automatic one that frames the stage, as usdrecord does."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils

from encore.adapters.context import Matrix, SyncContext, floats, number_of, to_matrix
from encore.adapters.matrix_motion import Matrices, world_keys
from encore.errors import StageError

AUTOMATIC = ""  # path of a camera that is not in the stage
# Of the lens; UsdGeomCamera has no such thing. Corners, and degrees.
APERTURE_BLADES, APERTURE_ROTATION = "encore:apertureBlades", "encore:apertureRotation"
_MOST_BLADES = 64
# UsdGeomBBoxCache recurses, and exhausts its stack below some thousands of levels and in cycles.
_DEEPEST = 1000


@dataclass(frozen=True)
class ShutterOptions:
    """opens, closes: in frames from the frame's time; None: the camera's."""

    motion_blur: bool = True
    opens: float | None = None
    closes: float | None = None


@dataclass(frozen=True)
class CameraData:
    """path: AUTOMATIC where it frames the stage. aspect: width / height of the film window.

    half_tangent, centre_tangent: film window at distance 1, or in the camera's units where orthographic; its
    height follows from the image's. clipping: distances along -Z, world units. clipping_planes: (a, b, c, d).
    motion: (k, 4, 4) to_world from shutter open to close. lens_radius, focus_distance: the camera's units.
    """

    path: str
    to_world: Matrix
    half_tangent: float
    centre_tangent: tuple[float, float]
    aspect: float
    clipping: tuple[float, float]
    orthographic: bool = False
    clipping_planes: tuple[tuple[float, ...], ...] = ()
    motion: Matrices | None = None
    lens_radius: float = 0.0
    focus_distance: float = 1.0
    aperture_blades: int = 0
    aperture_rotation_radians: float = 0.0
    exposure_scale: float = 1.0

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of _core.Scene.set_camera, but for the film window and the clipping range."""
        return {
            "projection": "orthographic" if self.orthographic else "perspective",
            "motion": self.motion,
            "clipping_planes": list(self.clipping_planes),
            "lens_radius": self.lens_radius,
            "focus_distance": self.focus_distance,
            "aperture_blades": self.aperture_blades,
            "aperture_rotation_radians": self.aperture_rotation_radians,
            "exposure_scale": self.exposure_scale,
        }

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector along which the camera looks, world space."""
        axis = -self.to_world[2, :3]
        x, y, z = axis / np.linalg.norm(axis)
        return float(x), float(y), float(z)


@dataclass(frozen=True)
class FilmOptions:
    """How a camera's aperture becomes an image.

    width and height in pixels; without a height, the camera decides it. pixel_aspect_ratio: width / height of
    a pixel. conform_policy: UsdRenderSettingsBase's
    aspectRatioConformPolicy; what usdrecord does is adjustApertureHeight.
    """

    width: int = 960
    height: int | None = None
    pixel_aspect_ratio: float = 1.0
    conform_policy: str = "adjustApertureHeight"


@dataclass(frozen=True)
class Film:
    """An image of a camera: its size in pixels, their shape, and the film window's half width and height."""

    width: int
    height: int
    half_tangents: tuple[float, float]
    pixel_aspect_ratio: float


def conform(camera: CameraData, options: FilmOptions) -> Film:
    """The film of a camera, whose aperture is adjusted where the image has another shape (UsdRenderSpec)."""
    pixel = options.pixel_aspect_ratio
    if not options.height:
        # The aperture is covered exactly, but for the rounding: no policy has anything to decide.
        width, height = image_size(options.width, None, camera.aspect / pixel)
        half = camera.half_tangent
        return Film(width, height, (half, half * height / (width * pixel)), pixel)
    width, height = options.width, options.height
    half_x, half_y = camera.half_tangent, camera.half_tangent / camera.aspect
    image_aspect = pixel * width / height
    wider = camera.aspect > image_aspect
    policy = options.conform_policy
    if policy == "adjustPixelAspectRatio":
        return Film(width, height, (half_x, half_y), camera.aspect * height / width)
    keeps_width = (
        policy == "adjustApertureHeight"
        or (policy == "expandAperture" and wider)
        or (policy == "cropAperture" and not wider)
    )
    if keeps_width:
        return Film(width, height, (half_x, half_x * height / (width * pixel)), pixel)
    return Film(width, height, (half_y * image_aspect, half_y), pixel)


def image_size(width: int, height: int | None, aspect: float) -> tuple[int, int]:
    """Pixels of the image; without a height, the one that the camera's aspect ratio gives (as usdrecord)."""
    if height:
        return width, height
    # In single precision, as usdrecord: 640 / (36 / 20.25) is 360 there and a little less in double.
    return width, max(1, int(np.float32(width) / np.float32(aspect)))


def choose_camera(stage: Usd.Stage, name: str, context: SyncContext) -> Usd.Prim | None:
    """The camera called `name` (a path, or a name anywhere on the stage); None: frame the stage.

    Without a name: the one called main_cam, else the only one there is. Raises StageError for a name that no
    camera has, and lists those there are.
    """
    if name and Sdf.Path.IsValidPathString(name) and Sdf.Path(name).IsAbsolutePath():
        prim = stage.GetPrimAtPath(name)
        if prim and prim.IsActive() and prim.IsA(UsdGeom.Camera):
            return prim
    cameras = [p for p in stage.Traverse() if p.IsA(UsdGeom.Camera)]
    if name:
        for prim in cameras:
            if name in (prim.GetName(), str(prim.GetPath())):
                return prim
        known = ", ".join(str(p.GetPath()) for p in cameras[:20]) + (", …" if len(cameras) > 20 else "")
        raise StageError(
            "there is no such camera", name, f"Choose one of: {known}" if known else "The stage has none"
        )
    return _default_camera(cameras, context)


def _default_camera(cameras: list[Usd.Prim], context: SyncContext) -> Usd.Prim | None:
    primary = UsdUtils.GetPrimaryCameraName()
    for prim in cameras:
        if prim.GetName() == primary:
            return prim
    if len(cameras) == 1:
        context.reports.note("camera", "is the stage's only camera, and is used", cameras[0].GetPath())
        return cameras[0]
    what = (
        f"none of the stage's {len(cameras)} cameras is called {primary}"
        if cameras
        else "the stage has no camera"
    )
    context.reports.note("camera", f"{what}, so the view frames all of it", "/")
    return None


def read_camera(
    prim: Usd.Prim, to_world: Matrix, context: SyncContext, *, depth_of_field: bool = True
) -> CameraData:
    """A camera of the stage. depth_of_field: whether its lens blurs what is out of focus."""
    camera = UsdGeom.Camera(prim)
    gf = camera.GetCamera(context.time)
    # Clipping distances are in the camera's own space.
    scale = float(np.linalg.norm(to_world[2, :3]))
    near, far = gf.clippingRange.min * scale, gf.clippingRange.max * scale
    data = _from_gf(gf, str(prim.GetPath()), to_world, (near, far))
    lens = _lens(gf, camera, context) if depth_of_field else {}
    return replace(
        data,
        clipping_planes=_clipping_planes(gf, prim.GetPath(), context),
        motion=world_keys(prim, context),
        exposure_scale=_exposure(camera, context),
        **lens,
    )


def read_shutter(prim: Usd.Prim, options: ShutterOptions, context: SyncContext) -> tuple[float, float]:
    """The shutter interval of a camera, in frames from the frame's time; (0, 0) where motion is not blurred.

    One that closes before it opens is reported.
    """
    camera = UsdGeom.Camera(prim)
    if not options.motion_blur:
        return 0.0, 0.0
    opens, closes = camera.GetShutterOpenAttr(), camera.GetShutterCloseAttr()
    interval = (
        number_of(opens, context.time) if options.opens is None else options.opens,
        number_of(closes, context.time) if options.closes is None else options.closes,
    )
    if not (math.isfinite(sum(interval)) and interval[0] <= interval[1]):
        context.reports.error(
            "bad shutter",
            f"its shutter closes at {interval[1]:g}, before it opens at {interval[0]:g}: nothing "
            "is blurred by motion",
            prim.GetPath(),
        )
        return 0.0, 0.0
    return interval


def stage_bounds(
    stage: Usd.Stage, depth: int, purposes: tuple[str, ...], context: SyncContext
) -> Gf.Range3d | None:
    """World bounds of the stage as usdrecord frames them; None where USD cannot tell.

    depth: of the deepest prim.
    """
    if depth > _DEEPEST or context.reports.count("instancing cycle"):
        return None
    cache = UsdGeom.BBoxCache(context.time, list(purposes), useExtentsHint=True)
    try:
        bounds = cache.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    except Tf.ErrorException:
        return None  # something broken on the stage, which is reported where it is translated
    finite = all(math.isfinite(x) for x in (*bounds.min, *bounds.max))
    return bounds if finite and not bounds.IsEmpty() else None


def frame_stage(bounds: Gf.Range3d, stage: Usd.Stage) -> CameraData:
    """A camera with the default lens that sees the bounds from the front, where usdrecord places it."""
    gf = Gf.Camera()
    centre, size = bounds.GetMidpoint(), bounds.GetSize()
    up, depth = (1, 2) if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else (2, 1)
    radius = math.hypot(size[0], size[up]) / 2
    half_view = math.radians(gf.GetFieldOfView(Gf.Camera.FOVHorizontal) / 2)
    distance = radius / math.tan(half_view) + size[depth] / 2
    if distance < gf.clippingRange.min:
        distance += gf.clippingRange.min
    matrix = Gf.Matrix4d(1)
    if up == 1:
        matrix.SetTranslate(centre + Gf.Vec3d(0, 0, distance))
    else:
        matrix.SetRotate(Gf.Rotation(Gf.Vec3d(1, 0, 0), 90))
        matrix.SetTranslateOnly(centre - Gf.Vec3d(0, distance, 0))
    # Nothing is clipped, however large or small the stage.
    return _from_gf(gf, AUTOMATIC, to_matrix(matrix), (0.0, 1e30))


def _from_gf(gf: Gf.Camera, path: str, to_world: Matrix, clipping: tuple[float, float]) -> CameraData:
    orthographic = gf.projection == Gf.Camera.Orthographic

    def window(aperture: float) -> float:
        """At distance 1, or in the camera's units. Apertures and focal length are in tenths of them."""
        if orthographic:
            return float(aperture * Gf.Camera.APERTURE_UNIT)
        return float(aperture / gf.focalLength) if gf.focalLength else math.inf

    # GfIsClose(aspect, 0, 1e-4) in usdrecord.
    aspect = gf.aspectRatio if gf.verticalAperture and abs(gf.aspectRatio) > 1e-4 else 1.0
    return CameraData(
        path=path,
        to_world=to_world,
        half_tangent=window(gf.horizontalAperture) / 2,
        centre_tangent=(window(gf.horizontalApertureOffset), window(gf.verticalApertureOffset)),
        aspect=aspect,
        clipping=clipping,
        orthographic=orthographic,
    )


def _lens(gf: Gf.Camera, camera: UsdGeom.Camera, context: SyncContext) -> dict[str, Any]:
    """Lens and focus of a camera with an f-number: the lens is focalLength / fStop wide (UsdGeomCamera)."""
    if gf.fStop <= 0:
        return {}
    radius = gf.focalLength * Gf.Camera.FOCAL_LENGTH_UNIT / gf.fStop / 2
    if not (
        math.isfinite(radius) and math.isfinite(gf.focusDistance) and gf.focusDistance > 0 and radius > 0
    ):
        context.reports.error(
            "bad lens",
            f"everything is in focus: fStop {gf.fStop:g}, focalLength {gf.focalLength:g} and focusDistance "
            f"{gf.focusDistance:g} do not make a lens",
            camera.GetPath(),
        )
        return {}
    prim = camera.GetPrim()
    blades = _number(prim, APERTURE_BLADES, context)
    if not (blades == int(blades) and 0 <= blades <= _MOST_BLADES):
        context.reports.error(
            f"bad {APERTURE_BLADES}",
            f"{APERTURE_BLADES} is {blades:g}, not a whole number from 0 to {_MOST_BLADES}: it is round",
            camera.GetPath(),
        )
        blades = 0
    return {
        "lens_radius": radius,
        "focus_distance": float(gf.focusDistance),
        "aperture_blades": int(blades),
        "aperture_rotation_radians": math.radians(_number(prim, APERTURE_ROTATION, context)),
    }


def _number(prim: Usd.Prim, name: str, context: SyncContext) -> float:
    """An attribute of Encore's own; 0 where it is not authored, or not a finite number."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(context.time) if attribute else None
    found = floats(value, 1) if value is not None else (0.0,)
    if found is None:
        context.reports.error(f"bad {name}", f"{name} is {value}, and is ignored", prim.GetPath())
        return 0.0
    return found[0]


def _clipping_planes(gf: Gf.Camera, path: Sdf.Path, context: SyncContext) -> tuple[tuple[float, ...], ...]:
    planes = []
    for plane in gf.clippingPlanes:
        numbers = floats(plane, 4)
        if numbers is None or not any(numbers[:3]):
            context.reports.error("bad clipping plane", f"{plane} is no plane, and is ignored", path)
        else:
            planes.append(numbers)
    return tuple(planes)


def _exposure(camera: UsdGeom.Camera, context: SyncContext) -> float:
    """What radiance is multiplied with: 2^exposure, and what exposure:* attributes say if USD knows them."""
    if hasattr(camera, "ComputeLinearExposureScale"):
        scale = float(camera.ComputeLinearExposureScale(context.time))
    else:
        attribute = camera.GetExposureAttr()
        scale = float(np.exp2(np.float64(attribute.Get(context.time) if attribute else 0.0)))
    if math.isfinite(scale) and scale >= 0:
        return scale
    context.reports.error("bad exposure", f"its exposure scale is {scale:g}: 1 is used", camera.GetPath())
    return 1.0
