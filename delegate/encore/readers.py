"""Readers of rprims: from a prim of one type to the mesh that core takes. One entry of READERS per type.

A reader reads the prim, its primvars and what it names in `depends`, and nothing else, so that what it gives
can be kept until one of them changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from encore.adapters import implicit
from encore.adapters.authored import Authored
from encore.adapters.context import Matrix, SyncContext
from encore.adapters.curves import read_curves
from encore.adapters.mesh import MeshData, read_color, read_mesh_prim, read_texcoords
from encore.adapters.points import read_points
from encore.adapters.primvars import (
    THIN_WALLED,
    ElementCounts,
    Wanted,
    four_wide,
    read_bool,
    read_wanted,
)
from encore.adapters.shading_rate import read_rates
from encore.adapters.skin_binding import may_be_skinned, read_skin
from encore.adapters.skin_dependencies import skin_dependencies


@dataclass(slots=True)
class Request:
    """What a reader is asked for. authored: names of the prim's properties with opinions.

    primvars: by name, inherited ones included. wanted: what the materials read.
    """

    prim: Usd.Prim
    path: Sdf.Path
    authored: Authored
    primvars: Mapping[str, UsdGeom.Primvar]
    wanted: Wanted
    context: SyncContext


@dataclass(slots=True)
class Geometry:
    """What a reader gives. data: its own from then on, but for arrays. to_prim: from its space to the prim's.

    share_key: equal for prims with the same geometry, which differ in material, shading rate and place only;
    None: shared with none. depends: other prims whose properties decide what was read; such a prim is read
    again at every other time.
    """

    data: MeshData
    to_prim: Matrix | None = None
    share_key: Any = None
    depends: frozenset[Sdf.Path] = frozenset()


_NOTHING: frozenset[Sdf.Path] = frozenset()

# None, and a report, where there is nothing to render.
Reader = Callable[[Request], Geometry | None]


def _read_mesh(request: Request) -> Geometry | None:
    names = request.authored.names
    data = read_mesh_prim(
        request.prim, request.path, names, request.primvars, request.wanted, request.context
    )
    return None if data is None else Geometry(data, depends=_skin(request))


def _read_curves(request: Request) -> Geometry | None:
    curves = UsdGeom.BasisCurves(request.prim)
    data = read_curves(curves, request.primvars, request.wanted, request.context)
    return None if data is None else Geometry(data, depends=_skin(request))


def _read_points(request: Request) -> Geometry | None:
    points = UsdGeom.Points(request.prim)
    data = read_points(points, request.primvars, request.wanted, request.context)
    return None if data is None else Geometry(data, depends=_skin(request))


def _skin(request: Request) -> frozenset[Sdf.Path]:
    bound = may_be_skinned(request.authored.names, request.primvars)
    return skin_dependencies(request.prim) if bound else _NOTHING


def _read_implicit(request: Request) -> Geometry | None:
    """The mesh of an implicit shape, shared where nothing of it is its own."""
    prim, path, context, wanted = request.prim, request.path, request.context, request.wanted
    shape = implicit.shape_of(prim, context)
    if shape is None:
        return None
    data = implicit.build(*shape.key)
    left_handed, double_sided = implicit.orientation(prim, context)
    counts = ElementCounts(data.face_count, len(data.points), len(data.face_vertex_indices))
    primvars = request.primvars
    constants = {n: p for n, p in primvars.items() if p.GetInterpolation() == UsdGeom.Tokens.constant}
    own = frozenset(data.texcoords) - constants.keys()
    texcoords = {name: data.texcoords[name] for name in own & wanted.texcoords}
    texcoords |= read_texcoords(
        constants, replace(wanted, texcoords=wanted.texcoords - own), counts, path, context
    )
    others = {name: width for name, width in wanted.primvars.items() if name not in own}
    read = read_wanted(constants, replace(wanted, primvars=others), counts, path, context)
    read |= {name: four_wide(data.texcoords[name]) for name in own & wanted.primvars.keys()}
    normals = data.normals
    if left_handed and normals is not None:
        normals = normals._replace(values=-normals.values)
    thin = read_bool(primvars, THIN_WALLED, path, context)
    thin = not implicit.is_solid(shape) if thin is None else thin
    key = (shape.key, left_handed, double_sided, thin, tuple(sorted(own & wanted.texcoords)))
    data = replace(
        data,
        path=str(path),
        left_handed=left_handed,
        double_sided=double_sided,
        normals=normals,
        texcoords=texcoords,
        primvars=read,
        thin_walled=thin,
        shading_rate=read_rates(primvars, context),
        display_color=read_color(constants, counts, path, context) if wanted.color else None,
    )
    skin = read_skin(prim, 1, context) if may_be_skinned((), primvars) else None
    if skin is not None:
        return Geometry(skin.carry(data.transformed(shape.to_prim), context), depends=_skin(request))
    shares = not read and texcoords.keys() <= own
    return Geometry(data, shape.to_prim, key if shares else None, depends=_skin(request))


# By type name. Types that derive from Mesh are read as it is.
READERS: dict[str, Reader] = {
    "Mesh": _read_mesh,
    "BasisCurves": _read_curves,
    "Points": _read_points,
    **dict.fromkeys(implicit.TYPES, _read_implicit),
}


def reader_of(prim: Usd.Prim, name: str) -> Reader | None:
    """name: of the prim's type. None where it is no rprim that can be rendered."""
    return READERS.get(name) or (_read_mesh if prim.IsA(UsdGeom.Mesh) else None)
