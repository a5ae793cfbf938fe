"""Meshes that emit: UsdLuxMeshLightAPI, UsdLuxLightAPI on any shape, and what GeometryLights name."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdLux

from encore.adapters.context import Matrix, SyncContext, floats
from encore.adapters.light import Colour, LightData, Shape, make_light
from encore.adapters.material import MaterialData
from encore.adapters.mesh import MeshData

WHITE: Colour = (1.0, 1.0, 1.0)


def read_mesh_light(
    prim: Usd.Prim, to_world: Matrix, path: str, data: MeshData, tint: Colour, context: SyncContext
) -> LightData | None:
    """The light that a rendered mesh is; None, and a report, where it cannot emit. Its instance is left open.

    prim: with UsdLuxLightAPI. path: of the instance. tint: of its radiance, see read_tint().
    """
    if data.shape != "faces":
        context.reports.add(f"light of {data.shape}", f"{data.shape} emit no light", prim.GetPath())
        return None
    light = make_light(prim, "mesh", to_world, path, Shape({}, mesh_area(data, to_world)), {}, context)
    if light is None:
        return None
    red, green, blue = (c * t for c, t in zip(light.radiance, tint, strict=True))
    return LightData(light.kind, light.path, (red, green, blue), light.shape)


def mesh_area(data: MeshData, to_world: Matrix) -> float:
    """Of the faces in world space: of subdivision surfaces, of their control mesh."""
    counts = data.face_vertex_counts.astype(np.int64)
    ends = np.cumsum(counts)
    if not len(counts) or counts.min() < 1 or ends[-1] > len(data.face_vertex_indices):
        return 0.0
    seen = np.ones(len(counts), bool)
    seen[data.hole_indices[(data.hole_indices >= 0) & (data.hole_indices < len(counts))]] = False
    # Fans: corner i of a face, the next one, and the face's first.
    corners = np.arange(ends[-1])
    first = np.repeat(ends - counts, counts)
    last = np.repeat(ends - 1, counts)
    used = (corners > first) & (corners < last) & np.repeat(seen, counts)
    points = data.points.astype(np.float64) @ to_world[:3, :3]
    a, b, c = (points[data.face_vertex_indices[i[used]]] for i in (first, corners, corners + 1))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)
    return area if np.isfinite(area) else 0.0


def keeps_material(prim: Usd.Prim) -> bool:
    """False with materialSyncMode noMaterialResponse: as if no material were bound."""
    return _sync_mode(prim) != UsdLux.Tokens.noMaterialResponse


def read_tint(prim: Usd.Prim, material: MaterialData, context: SyncContext) -> Colour:
    """With materialSyncMode materialGlowTintsLight the colour that the material glows in; else white.

    White as well where the material does not glow. A glow that varies over the mesh is reported.
    """
    if _sync_mode(prim) != UsdLux.Tokens.materialGlowTintsLight:
        return WHITE
    glow = material.inputs.get("emissive_color", (0.0, 0.0, 0.0))
    if isinstance(glow, dict) or material.surface_shader:
        context.reports.add(
            "glow that varies",
            "the glow of its material varies over the mesh, and does not tint its light "
            "(materialSyncMode materialGlowTintsLight)",
            prim.GetPath(),
        )
        return WHITE
    colour = floats(glow, 3)
    if colour is None or not any(colour):
        return WHITE
    red, green, blue = colour
    return red, green, blue


def _sync_mode(prim: Usd.Prim) -> str:
    """materialSyncMode; of a GeometryLight the schema's fallback, noMaterialResponse."""
    mode = UsdLux.LightAPI(prim).GetMaterialSyncModeAttr().Get()
    return str(mode) if mode else str(UsdLux.Tokens.noMaterialResponse)
