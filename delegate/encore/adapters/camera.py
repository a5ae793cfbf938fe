"""Cameras: which one, its film window, and the automatic one that frames the stage, as usdrecord does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils

from encore.adapters.context import Matrix, SyncContext, to_matrix
from encore.errors import StageError

AUTOMATIC = ""  # path of a camera that is not in the stage
# UsdGeomBBoxCache recurses, and exhausts its stack below some thousands of levels and in cycles.
_DEEPEST = 1000


@dataclass(frozen=True)
class CameraData:
    """path: AUTOMATIC where it frames the stage. aspect: width / height of the film window.

    half_tangent, centre_tangent: film window at distance 1; its height follows from the image's.
    clipping: distances along -Z, world units.
    """

    path: str
    to_world: Matrix
    half_tangent: float
    centre_tangent: tuple[float, float]
    aspect: float
    clipping: tuple[float, float]

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector along which the camera looks, world space."""
        axis = -self.to_world[2, :3]
        x, y, z = axis / np.linalg.norm(axis)
        return float(x), float(y), float(z)


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
        if prim and prim.IsA(UsdGeom.Camera):
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


def read_camera(prim: Usd.Prim, to_world: Matrix, context: SyncContext) -> CameraData:
    """A camera of the stage. Raises StageError for one that cannot be rendered."""
    camera = UsdGeom.Camera(prim)
    _check(camera, context)
    gf = camera.GetCamera(context.time)
    if gf.projection != Gf.Camera.Perspective:
        raise StageError(
            f"projection {camera.GetProjectionAttr().Get(context.time)} is not supported yet",
            f"{prim.GetPath()}.projection",
            "Choose a perspective camera",
        )
    # Clipping distances are in the camera's own space.
    scale = float(np.linalg.norm(to_world[2, :3]))
    near, far = gf.clippingRange.min * scale, gf.clippingRange.max * scale
    return _from_gf(gf, str(prim.GetPath()), to_world, (near, far))


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
    def tangent(aperture: float) -> float:
        return aperture / gf.focalLength if gf.focalLength else math.inf

    # GfIsClose(aspect, 0, 1e-4) in usdrecord.
    aspect = gf.aspectRatio if gf.verticalAperture and abs(gf.aspectRatio) > 1e-4 else 1.0
    return CameraData(
        path=path,
        to_world=to_world,
        half_tangent=tangent(gf.horizontalAperture) / 2,
        centre_tangent=(tangent(gf.horizontalApertureOffset), tangent(gf.verticalApertureOffset)),
        aspect=aspect,
        clipping=clipping,
    )


def _check(camera: UsdGeom.Camera, context: SyncContext) -> None:
    """Reports what the camera asks for and does not get."""
    time, path, reports = context.time, camera.GetPath(), context.reports
    if (camera.GetFStopAttr().Get(time) or 0) > 0:
        reports.add("lens blur", "fStop is not supported yet: everything is in focus", path)
    if camera.GetShutterCloseAttr().Get(time) > camera.GetShutterOpenAttr().Get(time):
        reports.add(
            "motion blur", "the shutter interval is not supported yet: nothing is blurred by motion", path
        )
    if camera.GetClippingPlanesAttr().Get(time):
        reports.add("clipping planes", "clippingPlanes are not supported yet", path)
    if abs(camera.ComputeLinearExposureScale(time) - 1) > 1e-6:
        reports.add("camera exposure", "the camera's exposure is not supported yet", path)
