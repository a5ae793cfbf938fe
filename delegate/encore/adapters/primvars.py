"""Primvars → arrays of the sizes that their interpolation asks for."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom, UsdShade

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
THIN_WALLED = "encore:thinWalled"
# What instances pass down to meshes of their prototype, beside texture coordinates and what materials read.
INHERITED = ("displayColor", "displayOpacity", TARGET_EDGE_LENGTH, THIN_WALLED, *SHADING_RATES)

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


@dataclass(frozen=True)
class Wanted:
    """What the materials of a mesh read of it.

    texcoords: by name. primvars: floats that are read of each one, by name. optional: those of both that
    may be missing without a report. color: displayColor. solidity: whether it is closed.
    """

    texcoords: frozenset[str] = frozenset()
    primvars: Mapping[str, int] = field(default_factory=dict)
    optional: frozenset[str] = frozenset()
    color: bool = False
    solidity: bool = False


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
    elements = primvar.GetElementSize()
    if elements != 1:
        reject(name, path, context, f"elementSize {elements} is not supported")
        return None
    found = width_of(primvar)
    if found != width:
        what = f"{found} floats" if found else f"no numbers ({primvar.GetTypeName()})"
        reject(name, path, context, f"it has {what} per element, not {width}")
        return None
    indices = None
    if primvar.IsIndexed():
        indices = np.asarray(primvar.GetIndices(context.time), dtype=np.int32)
    return make_primvar(name, primvar.GetInterpolation(), value, indices, width, counts, path, context)


def width_of(primvar: UsdGeom.Primvar) -> int:
    """Numbers of one element: 1 to 4; 0 for types that are no such numbers."""
    return _width_of_type(primvar.GetTypeName())


@functools.cache
def _width_of_type(type_name: Sdf.ValueTypeName) -> int:
    value = type_name.scalarType.defaultValue
    if isinstance(value, (bool, int, float)):
        return 1
    dimension = getattr(value, "dimension", 0)
    return dimension if isinstance(dimension, int) and dimension <= 4 else 0


def read_wanted(
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    counts: ElementCounts,
    path: Sdf.Path,
    context: SyncContext,
) -> dict[str, Primvar]:
    """The primvars that materials read besides texture coordinates, as four floats: what is missing is 0.

    Those that the mesh does not have, or has with fewer floats than are read, are left out and reported.
    """
    found = {}
    for name, width in sorted(wanted.primvars.items()):
        primvar = primvars.get(name)
        if primvar is None:
            if name not in wanted.optional:
                report_missing(name, "primvar", path, context)
            continue
        has = width_of(primvar)
        if has < width:
            what = f"{has} floats" if has else f"no numbers ({primvar.GetTypeName()})"
            reject(name, path, context, f"its material reads {width} floats per element, it has {what}")
            continue
        read = read_primvar(primvar, has, counts, path, context)
        if read is not None:
            found[name] = four_wide(read)
    return found


def four_wide(primvar: Primvar) -> Primvar:
    """The same values with zeros up to four floats."""
    values = np.zeros((len(primvar.values), 4), np.float32)
    values[:, : primvar.values.shape[1]] = primvar.values
    return primvar._replace(values=values)


def report_missing(name: str, what: str, path: Sdf.Path, context: SyncContext) -> None:
    context.reports.add(
        f"missing primvar {name}", f"its material reads {what} {name}, which the mesh does not have", path
    )


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
        values = np.asarray(value, dtype=np.float32, order="C")
        if values.shape[1:] != (width,):
            values = values.reshape(-1, width)
    except (TypeError, ValueError):
        reject(name, path, context, f"a value of {width} floats per element is needed")
        return None
    if values.size == 0:
        return None
    if not _are_finite(values):
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


def _are_finite(values: FloatArray) -> bool:
    if values.size <= 16:  # constants, of which there are many
        return all(map(math.isfinite, values.ravel().tolist()))
    return bool(np.isfinite(values).all())


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


def read_bool(
    primvars: Mapping[str, UsdGeom.Primvar], name: str, path: Sdf.Path, context: SyncContext
) -> bool | None:
    """The constant bool primvar `name`; None where it is not authored, or is no bool (which is reported)."""
    value = primvars[name].Get(context.time) if name in primvars else None
    if value is None:
        return None
    if not isinstance(value, (bool, int)):
        reject(name, path, context, f"its value is {value}, not a bool")
        return None
    return bool(value)


def inherited_signature(
    primvars: list[UsdGeom.Primvar], time: Usd.TimeCode, names: Collection[str] = ()
) -> tuple[object, ...]:
    """Equal for two prims that pass the same values of interest down to their descendants.

    names: of primvars that materials read, as read_by_materials() finds them.
    """
    signature = []
    for primvar in primvars:
        name = str(primvar.GetPrimvarName())
        if name in INHERITED or name in names or is_texcoord(primvar):
            value = primvar.ComputeFlattened(time)
            data = (
                np.asarray(value, dtype=np.float32).tobytes()
                if width_of(primvar) and value is not None
                else b""
            )
            signature.append((name, str(primvar.GetTypeName()), data))
    return tuple(sorted(signature))


def read_by_materials(stage: Usd.Stage, time: Usd.TimeCode) -> frozenset[str]:
    """Names of the primvars that any shader of the stage reads."""
    names = set()
    ranges = [stage.Traverse(), *(Usd.PrimRange(prototype) for prototype in stage.GetPrototypes())]
    for prim in itertools.chain.from_iterable(ranges):
        if prim.GetTypeName() != "Shader":
            continue
        shader = UsdShade.Shader(prim)
        if not str(shader.GetShaderId() or "").startswith("UsdPrimvarReader_"):
            continue
        varname = shader.GetInput("varname")
        for attribute in UsdShade.Utils.GetValueProducingAttributes(varname) if varname else ():
            names.add(str(attribute.Get(time)))
    return frozenset(names)


def might_vary(prim: Usd.Prim) -> bool:
    """Whether any property of a prim may have another value at another time."""
    # All of them: those that only value clips say something about are not authored.
    return bool(prim) and any(a.ValueMightBeTimeVarying() for a in prim.GetAttributes())


def inherited_vary(prim: Usd.Prim) -> bool:
    """Whether any primvar that a prim inherits may have another value at another time."""
    return any(
        p.ValueMightBeTimeVarying() for p in UsdGeom.PrimvarsAPI(prim.GetParent()).FindInheritablePrimvars()
    )


def _sizes(found: str, interpolation: str, expected: int) -> str:
    return f"{found}, but {interpolation} interpolation asks for {expected}"


def reject(name: str, path: Sdf.Path, context: SyncContext, why: str) -> None:
    """Reports a primvar that is not used. path: of the prim."""
    context.reports.error(f"bad primvar {name}", f"primvar {name} is ignored: {why}", path)
