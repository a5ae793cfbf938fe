"""Stages of very many instances, for the tests and measurements of their size.

    python tests/instanced_stages.py crowd|scatter [--count N] [--values]

renders one in a process of its own, and prints what it took as one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

GRID = 105  # faces along an edge of a prototype: 8 of them have 88,200 base faces
PARTS = 8
DISTRICTS = 40
PER_DISTRICT = 85  # clusters: 40 × 85 = 3,400 instances, of 300 million base faces


def _add_blob(stage: Usd.Stage, path: str, seed: int) -> None:
    """A closed Catmull-Clark surface of GRID × GRID quads: a torus with bumps of its own."""
    u = np.arange(GRID) / GRID * 2 * np.pi
    a, b = np.meshgrid(u, u, indexing="ij")
    radius = 0.25 + 0.04 * np.sin((3 + seed) * a) * np.cos((2 + seed % 3) * b)
    ring = 0.7 + radius * np.cos(b)
    points = np.stack([ring * np.cos(a), radius * np.sin(b), ring * np.sin(a)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(GRID), np.arange(GRID), indexing="ij")
    next_i, next_j = (i + 1) % GRID, (j + 1) % GRID
    faces = np.stack([i * GRID + j, i * GRID + next_j, next_i * GRID + next_j, next_i * GRID + j], axis=-1)
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(GRID * GRID, 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.reshape(-1).astype(np.int32)))


def crowd() -> Usd.Stage:
    """3,400 clusters of eight subdivision surfaces: PointInstancers of native instances, in native instances.

    Districts are native instances, each of its own displayColor; what they hold is a PointInstancer, whose
    prototype is a native instance of the cluster.
    """
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.CreateClassPrim("/Cluster")
    for part in range(PARTS):
        _add_blob(stage, f"/Cluster/Part{part}", part)
        blob = UsdGeom.Xformable(stage.GetPrimAtPath(f"/Cluster/Part{part}"))
        blob.AddTranslateOp().Set((2.2 * (part % 3), 0.6 * (part // 3), 2.2 * (part // 3)))
    stage.CreateClassPrim("/District")
    inner = UsdGeom.Xform.Define(stage, "/District/PI/Protos/Cluster").GetPrim()
    inner.GetReferences().AddInternalReference("/Cluster")
    inner.SetInstanceable(True)
    instancer = UsdGeom.PointInstancer.Define(stage, "/District/PI")
    instancer.CreatePrototypesRel().SetTargets([inner.GetPath()])
    instancer.CreateProtoIndicesAttr(Vt.IntArray(PER_DISTRICT))
    k = np.arange(PER_DISTRICT)
    positions = np.stack([8 * (k % 10), np.zeros(len(k)), 8 * (k // 10)], axis=-1).astype(np.float32)
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(positions))
    for district in range(DISTRICTS):
        placed = UsdGeom.Xform.Define(stage, f"/World/District{district}")
        placed.AddTranslateOp().Set((90.0 * (district % 8), 0, 80.0 * (district // 8)))
        placed.GetPrim().GetReferences().AddInternalReference("/District")
        placed.GetPrim().SetInstanceable(True)
        color = UsdGeom.PrimvarsAPI(placed).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray)
        color.Set([(0.2 + 0.015 * district, 0.5, 0.9 - 0.015 * district)])
    _add_camera(stage, (360, 160, 640), (360, 0, 200))
    return stage


def scatter(count: int, values: bool) -> Usd.Stage:
    """A PointInstancer of `count` cubes in a block; values: with a displayColor for each."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Cube.Define(stage, "/World/PI/Protos/Cube").CreateSizeAttr(0.5)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/PI")
    instancer.CreatePrototypesRel().SetTargets(["/World/PI/Protos/Cube"])
    instancer.CreateProtoIndicesAttr(Vt.IntArray(count))
    side = int(np.ceil(count ** (1 / 3)))
    k = np.arange(count)
    positions = np.stack([k % side, k // side % side, k // side**2], axis=-1).astype(np.float32)
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(positions))
    if values:
        color = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar(
            "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
        )
        color.Set(Vt.Vec3fArray.FromNumpy(positions / np.float32(side)))
    _add_camera(stage, (2.0 * side, 1.8 * side, 2.4 * side), (side / 2, side / 2, side / 2))
    return stage


def _add_camera(
    stage: Usd.Stage, eye: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateFocalLengthAttr(20.0)
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateVerticalApertureAttr(11.25)
    camera.CreateClippingRangeAttr((0.1, 1e6))
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(look.GetInverse())


def measure(stage: Usd.Stage, width: int = 160, height: int = 90, samples: int = 2) -> dict[str, Any]:
    """Syncs and renders; seconds, bytes, counts, and the mean and standard deviation of the image."""
    from encore import _core
    from encore.render_index import RenderIndex, SyncOptions

    def peak() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

    before = peak()
    start = time.perf_counter()
    translation = RenderIndex(stage, SyncOptions(camera="/Camera", width=width, height=height)).sync()
    synced = time.perf_counter()
    synced_peak = peak()
    settings = {"width": width, "height": height, "samples": samples, "occlusion_samples": 1}
    result = _core.render(translation.scene, settings, _core.create_device("", False))
    image = result["composite"]
    return {
        "counts": dict(translation.counts),
        "primitives": result["statistics"]["primitives"],
        "micropolygons": result["statistics"]["micropolygons"],
        "sync_s": synced - start,
        "render_s": time.perf_counter() - synced,
        "time_s": result["statistics"].get("time_s"),
        "stage_bytes": before,
        "sync_bytes": synced_peak,
        "peak_bytes": peak(),
        "mean": float(image.mean()),
        "deviation": float(image.std()),
        "colors": len(np.unique(np.round(image[..., :3].reshape(-1, 3), 2), axis=0)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("stage", choices=("crowd", "scatter"))
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--values", action="store_true")
    options = parser.parse_args()
    stage = crowd() if options.stage == "crowd" else scatter(options.count, options.values)
    print(json.dumps(measure(stage)))


SCRIPT = Path(__file__).resolve()
if __name__ == "__main__":
    main()
