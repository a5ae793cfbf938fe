"""Primvars → arrays of the sizes that their interpolation asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom

from encore.adapters.context import SyncContext

FloatArray = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int32]

TARGET_EDGE_LENGTH = "encore:targetEdgeLength"
# For all layers; then for one each, in core's order of layers. These win over the first, where above 0.
SHADING_RATE = "encore:shadingRate"
SHADING_RATES = (
    SHADING_RATE,
    *(f"{SHADING_RATE}:{layer}" for layer in ("direct", "reflection", "refraction")),
)
# What instances pass down to the meshes of their prototype; texture coordinates as well.
INHERITED = ("displayColor", "displayOpacity", TARGET_EDGE_LENGTH, *SHADING_RATES)

_TEXCOORD_TYPES = frozenset(
    str(t)
    for base in ("TexCoord2f", "Float2", "TexCoord2d", "Double2", "TexCoord2h", "Half2")
    for t in (getattr(Sdf.ValueTypeNames, base), getattr(Sdf.ValueTypeNames, f"{base}Array"))
)


@dataclass(frozen=True)
class ElementCounts:
    """How many elements a mesh has for each interpolation."""

    faces: int
    points: int
    corners: int

    def of(self, interpolation: str) -> int:
        sizes = {"constant": 1, "uniform": self.faces, "faceVarying": self.corners}
        return sizes.get(interpolation, self.points)


class Primvar(NamedTuple):
    """values: (n, width) float32. Element i has values[indices[i]], or values[i] without indices."""

    interpolation: str
    values: FloatArray
    indices: IntArray | None

    @property
    def is_constant(self) -> bool:
        """True where all elements have the same value, values[0], by interpolation."""
        return self.interpolation == "constant"

    def kept(self, elements: Mapping[str, npt.NDArray[np.bool_]]) -> Primvar:
        """Without the elements that are not kept, by interpolation; others are all kept."""
        keep = elements.get(self.interpolation)
        if keep is None:
            return self
        if self.indices is not None:
            return self._replace(indices=self.indices[keep])
        return self._replace(values=self.values[keep])


def is_texcoord(primvar: UsdGeom.Primvar) -> bool:
    """True for texture coordinates: arrays (or values) of two floats, by any name."""
    return str(primvar.GetTypeName()) in _TEXCOORD_TYPES


def read_primvar(
    primvar: UsdGeom.Primvar, width: int, counts: ElementCounts, path: Sdf.Path, context: SyncContext
) -> Primvar | None:
    """The primvar, or None where it has no value or cannot be used (which is reported).

    width: floats per element. path: the mesh, for messages.
    """
    value = primvar.Get(context.time)
    if value is None:
        return None
    name = str(primvar.GetPrimvarName())
    if primvar.GetElementSize() != 1:
        reject(name, path, context, f"elementSize {primvar.GetElementSize()} is not supported")
        return None
    indices = None
    if primvar.IsIndexed():
        indices = np.asarray(primvar.GetIndices(context.time), dtype=np.int32)
    return make_primvar(name, primvar.GetInterpolation(), value, indices, width, counts, path, context)


def make_primvar(
    name: str,
    interpolation: str,
    value: object,
    indices: IntArray | None,
    width: int,
    counts: ElementCounts,
    path: Sdf.Path,
    context: SyncContext,
) -> Primvar | None:
    """Checks type and sizes against the topology. None, and a report, where they do not fit."""
    try:
        values = np.ascontiguousarray(np.asarray(value, dtype=np.float32).reshape(-1, width))
    except (TypeError, ValueError):
        reject(name, path, context, f"a value of {width} floats per element is needed")
        return None
    if values.size == 0:
        return None
    if not np.isfinite(values).all():
        reject(name, path, context, "it holds infinite or NaN values")
        return None
    expected = counts.of(interpolation)
    if indices is not None:
        if indices.size != expected:
            reject(name, path, context, _sizes(f"{indices.size} indices", interpolation, expected))
            return None
        if indices.size and (indices.min() < 0 or indices.max() >= len(values)):
            reject(name, path, context, f"an index is out of range: there are {len(values)} values")
            return None
        return Primvar(interpolation, values, indices)
    if len(values) < expected:
        reject(name, path, context, _sizes(f"{len(values)} values", interpolation, expected))
        return None
    if len(values) > expected:
        found = _sizes(f"{len(values)} values", interpolation, expected)
        context.reports.add(f"long primvar {name}", f"primvar {name} has {found}: the rest is unused", path)
        values = np.ascontiguousarray(values[:expected])
    return Primvar(interpolation, values, None)


def read_number(
    primvars: Mapping[str, UsdGeom.Primvar], name: str, path: Sdf.Path, context: SyncContext
) -> float:
    """The constant float primvar `name`, which must be positive; 0 where there is none."""
    if name not in primvars:
        return 0.0
    value = primvars[name].Get(context.time)
    if value is None:
        return 0.0
    try:
        number = float(np.asarray(value, dtype=np.float64).ravel()[0])
    except (TypeError, ValueError, IndexError):
        number = np.nan
    if not np.isfinite(number) or number < 0:
        reject(name, path, context, f"its value is {value}, not a finite number of at least 0")
        return 0.0
    return number


def inherited_signature(primvars: list[UsdGeom.Primvar], time: Usd.TimeCode) -> tuple[object, ...]:
    """Equal for two prims that pass the same values of interest down to their descendants."""
    signature = []
    for primvar in primvars:
        name = str(primvar.GetPrimvarName())
        if name in INHERITED or is_texcoord(primvar):
            value = primvar.ComputeFlattened(time)
            data = np.asarray(value, dtype=np.float32).tobytes() if value is not None else b""
            signature.append((name, str(primvar.GetTypeName()), data))
    return tuple(sorted(signature))


def _sizes(found: str, interpolation: str, expected: int) -> str:
    return f"{found}, but {interpolation} interpolation asks for {expected}"


def reject(name: str, path: Sdf.Path, context: SyncContext, why: str) -> None:
    """Reports a primvar that is not used. path: of the prim."""
    context.reports.error(f"bad primvar {name}", f"primvar {name} is ignored: {why}", path)
