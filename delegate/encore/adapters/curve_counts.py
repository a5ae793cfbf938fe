"""How many segments curves have, and values for each interpolation, as UsdGeomBasisCurves counts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from encore.adapters.primvars import ElementCounts, IntArray

_STEPS = {"bezier": 3}


@dataclass(frozen=True)
class CurveCounts(ElementCounts):
    """How many elements curves have for each interpolation. corners: ends of segments, for varying.

    faces: curves.
    """

    def of(self, interpolation: str) -> int:
        return self.corners if interpolation == "varying" else super().of(interpolation)


def segment_counts(per_curve: IntArray, basis: str, wrap: str) -> npt.NDArray[np.int32]:
    """Segments of each curve as UsdGeomBasisCurves counts them; 0 where the number of points is wrong.

    basis: "linear", for curves of that type, or UsdGeomBasisCurves'.
    """
    n, step = per_curve.astype(np.int32), _STEPS.get(basis, 1)
    if wrap == "periodic":
        wrong = (n < (3 if basis == "linear" else 1)) | (n % step != 0)
        return np.where(wrong, 0, n // step).astype(np.int32)
    if wrap == "pinned" and basis in ("bspline", "catmullRom"):
        return np.maximum(n - 1, 0).astype(np.int32)
    first = 2 if basis == "linear" else 4
    wrong = (n < first) | ((n - first) % step != 0)
    return np.where(wrong, 0, (n - first) // step + 1).astype(np.int32)
