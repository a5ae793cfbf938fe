"""What every adapter needs while it reads a prim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Usd

from encore.report import Reports

# (4, 4), USD's row-vector convention: point * matrix.
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SyncContext:
    """What all adapters share. time: at which everything is read.

    shutter: stage times of its opening and closing, in this order; None: nothing is blurred by motion.
    """

    stage: Usd.Stage
    time: Usd.TimeCode
    reports: Reports
    shutter: tuple[float, float] | None = None


def to_matrix(matrix: Gf.Matrix4d) -> Matrix:
    """USD's matrix as an array."""
    return np.array(matrix, dtype=np.float64)


def floats(value: Any, count: int) -> tuple[float, ...] | None:
    """`value` as `count` finite numbers, or None when it is not that. One number does not become three."""
    try:
        array = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        return None
    if array.size != count or not np.isfinite(array).all():
        return None
    return tuple(float(x) for x in array)
