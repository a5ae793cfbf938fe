"""What every adapter needs while it reads a prim."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
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
    memo: what adapters keep while the stage is as it is, by type.
    """

    stage: Usd.Stage
    time: Usd.TimeCode
    reports: Reports
    shutter: tuple[float, float] | None = None
    memo: dict[type, Any] = field(default_factory=dict, compare=False, repr=False)


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


class BadValueError(Exception):
    """Says which attribute has a value that is of no use, and why."""


def array_of(name: str, value: Any, dtype: type[np.number[Any]], columns: int = 0) -> npt.NDArray[Any]:
    """An attribute's array as numbers, (n,) or (n, columns): a view where USD has it so. Empty for None.

    Other precisions are converted. Raises BadValueError for what are no such numbers.
    """
    array = np.asarray(value if value is not None else ())
    row = (columns,) if columns else ()
    if array.dtype == dtype and array.size and array.ndim and array.shape[1:] == row:
        return array
    if array.size == 0:
        return np.empty((0, columns) if columns else 0, dtype)
    whole = bool(np.issubdtype(dtype, np.integer))
    shape = (len(array), columns) if columns and array.ndim else array.shape[:1]
    if array.ndim == 0 or array.shape != shape or array.dtype.kind not in ("iu" if whole else "fiu"):
        what = "whole numbers" if whole else f"vectors of {columns} numbers" if columns else "numbers"
        raise BadValueError(f"{name}: its value is no array of {what}. Author it with the schema's type")
    converted = array.astype(dtype, copy=False)
    if whole and array.dtype != dtype and not np.array_equal(converted, array):
        raise BadValueError(f"{name}: it holds numbers beyond {np.iinfo(np.int32).max}")
    return converted


def number_of(attribute: Usd.Attribute, time: Usd.TimeCode) -> float:
    """The value of an attribute that is one number; NaN where it has none, or of another type."""
    try:
        return float(attribute.Get(time))
    except (TypeError, ValueError):
        return math.nan
