"""What the parts of the bench share: scenes, converged truth, errors, and timed renders."""

from __future__ import annotations

import argparse
import hashlib
import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import flip_evaluator
import numpy as np
from encore import _core
from pxr import Usd
from rendering import ROOT, render, rmse, total

sys.path.insert(0, str(ROOT / "examples" / "paper"))
import make_car
import make_magnifying_glass
import make_mirror_and_glass
import make_rolling_balls

FOLDER = ROOT / "build" / "bench"  # scenes and truth, which are made once

# Fixed for every image, so that FLIP values of different methods can be compared.
EXPOSURES = {"startExposure": -2.0, "stopExposure": 2.0, "numExposures": 5}

# The rays of the paper's experiments (§4) are not given; these are Encore's defaults.
RAYS = {"light_samples": 16, "occlusion_samples": 64}
BLOCK = 16  # pixels; errors are averaged over blocks of this side where their spread over seeds is asked for

# Share of the frame that the paper's reuse takes (Table 1: reuse over total time).
PAPER_SHARES = {"Fig. 1": 0.017, "Fig. 5": 0.107, "Fig. 6": 0.124, "Fig. 7": 0.004}


@dataclass(frozen=True)
class Scene:
    """A stage and how it is rendered. settings: antialiasing samples and bounces."""

    name: str
    stage: Usd.Stage
    size: tuple[int, int]
    settings: dict[str, Any]

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    def render(self, **settings: Any) -> dict[str, Any]:
        return render(self.stage, *self.size, **{"shading_rate": 2.0, "seed": 1, **self.settings, **settings})


SCENES = ("still_life", "mirror_and_glass", "car", "car_full", "magnifying_glass", "rolling_balls")
MAKERS = {
    "mirror_and_glass": make_mirror_and_glass.make,
    "magnifying_glass": make_magnifying_glass.make,
    "rolling_balls": make_rolling_balls.make,
}


def load(name: str, arguments: argparse.Namespace) -> Scene:
    """arguments: width and samples, each None for the scene's own; quick."""
    settings: dict[str, Any]
    if name == "still_life":
        stage = Usd.Stage.Open(str(ROOT / "examples" / "still_life.usda"))
        width, height, settings = 480, 270, {"samples": 11}
    else:
        make = MAKERS.get(name, make_car.make)
        quick = arguments.quick or name == "car"
        path = FOLDER / f"{name}_quick.usdc" if quick else FOLDER / f"{name}.usdc"
        FOLDER.mkdir(parents=True, exist_ok=True)
        make(path, quick).GetRootLayer().Export(str(path))
        stage = Usd.Stage.Open(str(path))
        settings = dict(stage.GetRootLayer().customLayerData["encore"])
        width, height = settings.pop("width"), settings.pop("height")
        settings = {key: int(value) for key, value in settings.items()}
    if arguments.width:
        width, height = arguments.width, round(arguments.width * height / width)
    if arguments.samples:
        settings["samples"] = arguments.samples
    settings["threads"] = arguments.threads
    return Scene(name, stage, (int(width), int(height)), settings)


@dataclass(frozen=True)
class Truth:
    """A converged image, its layers, and the means over blocks of every independent pass of it."""

    image: np.ndarray
    layers: dict[str, np.ndarray]
    passes: np.ndarray  # (passes, blocks)
    samples_per_pixel: int


def block_means(image: np.ndarray) -> np.ndarray:
    """(blocks,): means over blocks of pixels and the colours; incomplete blocks are left out."""
    rows, columns = (n // BLOCK for n in image.shape[:2])
    whole = image[: rows * BLOCK, : columns * BLOCK].astype(float)
    return whole.reshape(rows, BLOCK, columns, BLOCK, -1).mean(axis=(1, 3, 4)).ravel()


def converged(scene: Scene, passes: int) -> Truth:
    """Mean of independent seeds of distribution ray tracing: the same transport, no reuse.

    Kept in build/bench, for the same stage, settings and build of Encore.
    """
    settings = {**scene.settings, "samples": 16, "light_samples": 2, "occlusion_samples": 2}
    digest = hashlib.sha256(Path(_core.__file__).read_bytes())
    digest.update(scene.stage.GetRootLayer().ExportToString().encode())
    digest.update(repr((scene.size, sorted(settings.items()), passes)).encode())
    kept = FOLDER / f"truth_{scene.name}_{digest.hexdigest()[:16]}.npz"
    if not kept.exists():
        means: dict[str, np.ndarray] = {}
        blocks = []
        for seed in range(passes):
            result = scene.render(method="reference", **{**settings, "seed": 1000 + seed})
            for name, image in {"": result["composite"], **result["layers"]}.items():
                means[name] = means.get(name, np.zeros(image.shape)) + image / passes
            blocks.append(block_means(result["composite"]))
        FOLDER.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, Any] = {f"layer_{name}": i.astype(np.float32) for name, i in means.items()}
        np.savez(kept, passes=np.array(blocks), **arrays)
    with np.load(kept) as data:
        layers = {key[6:]: data[key] for key in data.files if key.startswith("layer_")}
        return Truth(layers.pop(""), layers, data["passes"], 256 * passes)


def flip(reference: np.ndarray, image: np.ndarray) -> float:
    _, mean, _ = flip_evaluator.evaluate(reference, image, "HDR", True, False, True, EXPOSURES)
    return float(mean)


def timed(scene: Scene, runs: int, patience: float, **settings: Any) -> tuple[list[float], list[dict]]:
    """Seconds and results of `runs` renders; of one where the first takes longer than `patience` seconds."""
    seconds, results = list[float](), list[dict]()
    while len(seconds) < runs and (not seconds or seconds[0] <= patience):
        start = time.perf_counter()
        results.append(scene.render(**settings))
        seconds.append(time.perf_counter() - start)
    return seconds, results


def measure(scene: Scene, truth: Truth, arguments: argparse.Namespace, **settings: Any) -> dict[str, Any]:
    """Medians of the times, end to end and by stage; counts and errors of the first run (all are equal)."""
    seconds, results = timed(scene, arguments.runs, arguments.patience, **settings)
    result = results[0]
    samples = scene.pixels * settings.get("samples", scene.settings["samples"]) ** 2
    stages = {
        stage: statistics.median(r["statistics"]["time_s"][stage] for r in results)
        for stage in result["statistics"]["time_s"]
    }
    shades = total(result, "shading_evaluations")
    return {
        "runs": len(seconds),
        "seconds": statistics.median(seconds),
        "time_s": stages,
        "shading_evaluations": shades,
        "shading_evaluations_per_pixel": shades / scene.pixels,
        "reshaded_share": total(result, "reshading_evaluations") / max(1, shades),
        "failed_share": total(result, "failed_samples") / max(1, total(result, "antialiasing_samples")),
        "rays_traced": result["statistics"]["rays_traced"],
        "reuse_share_of_frame": stages["reuse"] / stages["total"],
        # Trees, search and failures over tracing, both per antialiasing sample of the frame.
        "reuse_ns_per_sample": 1e9 * stages["reuse"] / samples,
        "trace_ns_per_sample": 1e9 * stages["trace"] / samples,
        "reuse_over_trace": stages["reuse"] / max(1e-9, stages["trace"]),
        "device_peak_bytes": result["statistics"]["device_peak_bytes"],
        "rmse": rmse(truth.image, result["composite"]),
        "flip": flip(truth.image, result["composite"]),
        "layer_rmse": {name: rmse(truth.layers[name], image) for name, image in result["layers"].items()},
        "settings": settings,
    }


def t_quantile(probability: float, freedom: float) -> float:
    """Quantile of Student's t, by its expansion around the normal one; good to 1e-3 from 5 degrees on.

    Abramowitz and Stegun 26.7.5.
    """
    z = statistics.NormalDist().inv_cdf(probability)
    return (
        z
        + (z**3 + z) / (4 * freedom)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * freedom**3)
    )


def mean_difference(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of independent rows of a and of b: difference of their means, its standard error, and Welch's degrees
    of freedom."""
    va, vb = a.var(axis=0, ddof=1) / len(a), b.var(axis=0, ddof=1) / len(b)
    both = np.maximum(va + vb, 1e-300)
    freedom = both**2 / np.maximum(va**2 / (len(a) - 1) + vb**2 / (len(b) - 1), 1e-300)
    return a.mean(axis=0) - b.mean(axis=0), np.sqrt(both), np.maximum(freedom, 1.0)
