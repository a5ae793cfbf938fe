"""Renders stages small, and puts the pictures together: a look at everything at once.

    python tests/contact_sheet.py OUTPUT.png STAGE... [-- options of `encore record`]

Stages are files, or folders of which all root stages are taken: those that no other file in the folder names.
What fails gets an empty red cell, and the exit code 1. Times and messages go to standard output.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

WIDTH, HEIGHT, LABEL, COLUMNS = 320, 240, 24, 5
_SUFFIXES = {".usd", ".usda", ".usdc", ".usdz"}

Picture = npt.NDArray[np.float32]


def stages_in(arguments: Iterable[str]) -> list[Path]:
    """Files as they are; of folders the stages that are nobody's layer."""
    found: list[Path] = []
    for argument in map(Path, arguments):
        if not argument.is_dir():
            found.append(argument)
            continue
        files = sorted(p for p in argument.rglob("*") if p.suffix in _SUFFIXES)
        named = {name for path in files for name in _named_files(path)}
        found += [path for path in files if path.resolve() not in named]
    return found


def _named_files(path: Path) -> set[Path]:
    """Files that a layer names, as far as they are files beside it."""
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(str(path))
    names = layer.GetCompositionAssetDependencies() if layer else []
    return {Path(layer.ComputeAbsolutePath(name)).resolve() for name in names} - {path.resolve()}


def render(stage: Path, options: Sequence[str]) -> tuple[Picture | None, float, str]:
    """The picture, or None; seconds; and what was said."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "picture.png"
        size = ("--imageWidth", str(WIDTH))
        run = subprocess.run(
            [sys.executable, "-m", "encore", "record", *size, *options, str(stage), str(output)],
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - started
        said = "\n".join(
            line for line in (run.stdout + run.stderr).splitlines() if re.match("Error|Warning", line)
        )
        if run.returncode:
            return None, seconds, said or f"exit code {run.returncode}"
        return oiio.ImageBuf(str(output)).get_pixels(oiio.FLOAT)[..., :3], seconds, said


def cell(picture: Picture | None, label: str) -> oiio.ImageBuf:
    """A picture in the middle of its cell, over its label."""
    canvas = oiio.ImageBuf(oiio.ImageSpec(WIDTH, HEIGHT + LABEL, 3, "float"))
    oiio.ImageBufAlgo.fill(canvas, (0.15, 0.15, 0.15) if picture is not None else (0.4, 0, 0))
    if picture is not None:
        shown = picture[:HEIGHT]
        y = (HEIGHT - shown.shape[0]) // 2
        height, width = shown.shape[:2]
        canvas.set_pixels(oiio.ROI(0, width, y, y + height, 0, 1, 0, 3), np.ascontiguousarray(shown))
    oiio.ImageBufAlgo.render_text(canvas, 4, HEIGHT + LABEL - 7, label[-44:], 12, "", (1.0, 1.0, 1.0))
    return canvas


def main(arguments: Sequence[str]) -> int:
    split = arguments.index("--") if "--" in arguments else len(arguments)
    output, options = arguments[0], arguments[split + 1 :]
    stages = stages_in(arguments[1:split])
    rows = -(-len(stages) // COLUMNS)
    sheet = oiio.ImageBuf(oiio.ImageSpec(COLUMNS * WIDTH, rows * (HEIGHT + LABEL), 3, "uint8"))
    failed = 0
    for i, stage in enumerate(stages):
        picture, seconds, said = render(stage, options)
        failed += picture is None
        print(f"{'FAILED ' if picture is None else ''}{stage} {seconds:.1f} s\n{said}", flush=True)
        part = cell(picture, "/".join(stage.parts[-2:]))
        x, y = i % COLUMNS * WIDTH, i // COLUMNS * (HEIGHT + LABEL)
        oiio.ImageBufAlgo.paste(sheet, x, y, 0, 0, part)
    sheet.write(output)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
