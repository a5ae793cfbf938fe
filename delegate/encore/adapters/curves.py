"""UsdGeom.BasisCurves → the arrays that core takes: tubes, or ribbons where the curves have normals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, UsdGeom

from encore.adapters.context import BadValueError, SyncContext, array_of
from encore.adapters.curve_counts import CurveCounts, segment_counts
from encore.adapters.mesh import (
    MeshData,
    read_color,
    read_edge_length,
    read_normals,
    read_pose,
    read_texcoords,
)
from encore.adapters.primvars import (
    THIN_WALLED,
    ElementCounts,
    IntArray,
    Primvar,
    Wanted,
    make_primvar,
    read_bool,
    read_primvar,
    read_wanted,
)
from encore.adapters.shading_rate import read_rates

_NO_INTS: IntArray = np.empty(0, np.int32)
_BASES = ("bezier", "bspline", "catmullRom")
_WRAPS = ("nonperiodic", "periodic", "pinned")


def read_curves(
    curves: UsdGeom.BasisCurves,
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    context: SyncContext,
) -> MeshData | None:
    """The curves at the context's time, or None (and a report) where there are none, or they are broken.

    primvars: by name, inherited ones included.
    """
    path = curves.GetPath()
    try:
        points = array_of("points", curves.GetPointsAttr().Get(context.time), np.float32, 3)
        vertex_counts = curves.GetCurveVertexCountsAttr().Get(context.time)
        per_curve = array_of("curveVertexCounts", vertex_counts, np.int32)
    except BadValueError as error:
        context.reports.error("bad curves", f"is not rendered: {error}", path)
        return None
    if not points.size or not per_curve.size:
        context.reports.add("empty curves", "has no points or no curves, and is not rendered", path)
        return None
    basis, wrap = _kind(curves, context)
    segments = segment_counts(per_curve, basis, wrap)
    if per_curve.sum() != len(points) or segments.min() < 1:
        _reject(per_curve, len(points), segments, f"{wrap} {basis}", path, context)
        return None
    ends = int(segments.sum()) + (0 if wrap == "periodic" else len(per_curve))
    counts = CurveCounts(len(per_curve), len(points), ends)
    normals = read_normals(curves, curves.GetNormalsAttr().Get(context.time), primvars, counts, context)
    data = MeshData(
        path=str(path),
        points=points,
        face_vertex_counts=per_curve,
        face_vertex_indices=_NO_INTS,
        shape="curves",
        basis=basis,
        wrap=wrap,
        widths=read_widths(curves, curves.GetWidthsAttr(), primvars, counts, context),
        double_sided=True,
        normals=normals,
        display_color=read_color(primvars, counts, path, context) if wanted.color else None,
        texcoords=read_texcoords(primvars, wanted, counts, path, context),
        primvars=read_wanted(primvars, wanted, counts, path, context),
        target_edge_length_world=read_edge_length(primvars, path, context),
        shading_rate=read_rates(primvars, context),
    )
    read_pose(data, curves, None, primvars, context)
    if wanted.solidity:
        thin = read_bool(primvars, THIN_WALLED, path, context)
        data.thin_walled = normals is not None if thin is None else thin
    return data


def read_widths(
    prim: UsdGeom.Curves | UsdGeom.Points,
    attribute: Any,
    primvars: Mapping[str, UsdGeom.Primvar],
    counts: ElementCounts,
    context: SyncContext,
) -> Primvar | None:
    """Diameters; None: 1, which is Hydra's width of what has none. primvars:widths before widths (attribute).

    One value is good for all, whatever its interpolation. Widths below 0 are reported, and count as 0;
    widths whose number is wrong are reported, and the first one counts for all.
    """
    path = prim.GetPath()
    value: Any = None
    if "widths" in primvars:
        name, interpolation = "widths", str(primvars["widths"].GetInterpolation())
        widths = read_primvar(primvars["widths"], 1, counts, path, context)
        if widths is None:
            value = primvars["widths"].Get(context.time)
    else:
        name, interpolation = "widths", str(prim.GetWidthsInterpolation())
        try:
            value = array_of(name, attribute.Get(context.time), np.float32)
        except BadValueError as error:
            context.reports.error("bad widths", f"{error}: they count as 1", path)
        if value is None or not value.size:
            return None
        if len(value) == 1:
            interpolation = "constant"
        widths = make_primvar(name, interpolation, value, None, 1, counts, path, context)
    if widths is None:
        try:
            known = np.asarray(value if value is not None else (), dtype=np.float32).ravel()
        except (TypeError, ValueError):
            return None
        if not known.size or not np.isfinite(known[0]):
            return None
        widths = Primvar("constant", known[:1].reshape(1, 1), None)
    negative = int(np.count_nonzero(widths.values < 0))
    if negative:
        context.reports.error("bad widths", f"{negative} of its widths are below 0, and count as 0", path)
        widths = widths._replace(values=np.maximum(widths.values, np.float32(0)))
    return widths._replace(values=widths.values.ravel())


def _kind(curves: UsdGeom.BasisCurves, context: SyncContext) -> tuple[str, str]:
    """Basis ("linear" for curves of that type) and wrap; others than USD's are reported."""
    kind, basis = str(curves.GetTypeAttr().Get()), str(curves.GetBasisAttr().Get())
    wrap = str(curves.GetWrapAttr().Get())
    if kind == UsdGeom.Tokens.linear:
        basis = "linear"
    elif basis not in _BASES:
        context.reports.error(
            "bad curves", f"basis {basis} is not supported: bezier is used", curves.GetPath()
        )
        basis = "bezier"
    if wrap not in _WRAPS:
        context.reports.error("bad curves", f"wrap {wrap} is none: nonperiodic is used", curves.GetPath())
        wrap = "nonperiodic"
    return basis, wrap


def _reject(
    per_curve: IntArray,
    points: int,
    segments: npt.NDArray[np.int32],
    kind: str,
    path: Sdf.Path,
    context: SyncContext,
) -> None:
    """Reports curves whose numbers of points are wrong."""
    wrong = np.flatnonzero(segments < 1)
    if wrong.size:
        found = f"curve {wrong[0]} has {per_curve[wrong[0]]} points, which are no {kind} curve"
    else:
        found = f"has {points} points, but curveVertexCounts ask for {per_curve.sum()}"
    context.reports.error("bad curves", f"{found}: it is not rendered", path)
