"""Renders AOVs to numpy arrays, and says a few things of them.

python examples/python/aovs_to_numpy.py STAGE
"""

import sys

import encore
import numpy as np


def main(stage_path: str) -> None:
    with encore.Renderer(stage_path, width=240, samples=3) as renderer:
        image = renderer.render(aovs=("color", "direct", "reflection", "refraction", "depth", "instanceId"))

    covered = np.isfinite(image["depth"])
    print(f"{image.width} x {image.height} pixels, {covered.mean():.0%} of them covered")
    if covered.any():
        near, far = image["depth"][covered].min(), image["depth"][covered].max()
        print(f"depth: {near:.4g} to {far:.4g}")
    total = image["color"][..., :3].sum()
    for layer in ("direct", "reflection", "refraction"):
        print(f"{layer}: {image[layer].sum() / total:.1%} of the light")
    ids, counts = np.unique(image["instanceId"][covered], return_counts=True)
    print(f"{len(ids)} instances are seen; the largest has {counts.max(initial=0)} pixels")
    for report in image.reports:
        print(report.line())


if __name__ == "__main__":
    main(sys.argv[1])
