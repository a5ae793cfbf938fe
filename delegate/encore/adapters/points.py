"""UsdGeom.Points → the arrays that core takes: spheres."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pxr import UsdGeom

from encore.adapters.context import BadValueError, SyncContext, array_of
from encore.adapters.curves import read_widths
from encore.adapters.mesh import MeshData, read_color, read_pose, read_texcoords
from encore.adapters.primvars import (
    THIN_WALLED,
    ElementCounts,
    IntArray,
    Wanted,
    read_bool,
    read_wanted,
)
from encore.adapters.shading_rate import read_rates

_NO_INTS: IntArray = np.empty(0, np.int32)


def read_points(
    prim: UsdGeom.Points,
    primvars: Mapping[str, UsdGeom.Primvar],
    wanted: Wanted,
    context: SyncContext,
) -> MeshData | None:
    """The points at the context's time, or None (and a report) where there are none.

    primvars: by name, inherited ones included. Those without a width are left out, and reported.
    """
    path = prim.GetPath()
    try:
        points = array_of("points", prim.GetPointsAttr().Get(context.time), np.float32, 3)
    except BadValueError as error:
        context.reports.error("bad points", f"is not rendered: {error}", path)
        return None
    if not points.size:
        context.reports.add("empty points", "has no points, and is not rendered", path)
        return None
    counts = ElementCounts(len(points), len(points), len(points))
    widths = read_widths(prim, prim.GetWidthsAttr(), primvars, counts, context)
    data = MeshData(
        path=str(path),
        points=points,
        face_vertex_counts=_NO_INTS,
        face_vertex_indices=_NO_INTS,
        shape="points",
        widths=widths,
        double_sided=bool(prim.GetDoubleSidedAttr().Get()),
        display_color=read_color(primvars, counts, path, context) if wanted.color else None,
        texcoords=read_texcoords(primvars, wanted, counts, path, context),
        primvars=read_wanted(primvars, wanted, counts, path, context),
        shading_rate=read_rates(primvars, context),
    )
    if widths is not None:
        used = widths.values if widths.indices is None else widths.values[widths.indices]
        none = int(np.count_nonzero(used == 0)) * (len(points) if widths.is_constant else 1)
        if none == len(points):
            context.reports.add("points without width", "has no width, and is not rendered", path)
            return None
        if none:
            context.reports.add(
                "points without width", f"{none} of its points have no width, and are not rendered", path
            )
    read_pose(data, prim, None, primvars, context)
    if wanted.solidity:
        data.thin_walled = bool(read_bool(primvars, THIN_WALLED, path, context))
    return data
