"""The scene under construction, which takes rprims, sprims and bprims as a Hydra render delegate does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, UsdShade

from encore import _core
from encore.adapters.camera import CameraData
from encore.adapters.context import SyncContext
from encore.adapters.instancer import Matrices
from encore.adapters.light import LightData
from encore.adapters.material import (
    MaterialData,
    color_material,
    default_material,
    display_color_material,
    read_material,
)
from encore.adapters.mesh import MeshData
from encore.adapters.primvars import IntArray, Primvar
from encore.adapters.shading_rate import RateArray
from encore.adapters.texture import Textures
from encore.settings import SETTINGS, Setting


@dataclass(frozen=True)
class BoundMaterial:
    """A material of the scene: its index there, and what it was made from."""

    index: int
    data: MaterialData


class RenderDelegate:
    """Fills an encore._core.Scene. Types go by Hydra's names; encore.population maps USD's types to them."""

    SUPPORTED_RPRIM_TYPES = ("mesh",)
    SUPPORTED_SPRIM_TYPES = (
        "camera",
        "material",
        "distantLight",
        "rectLight",
        "diskLight",
        "sphereLight",
        "cylinderLight",
        "domeLight",
        "meshLight",
    )
    SUPPORTED_BPRIM_TYPES = ("texture",)

    def __init__(self, context: SyncContext) -> None:
        self.scene = _core.Scene()
        self._context = context
        self.textures = Textures(self.scene, context)
        self._materials: dict[Any, BoundMaterial | None] = {}
        self.default_material = self._add_material("default", default_material())

    @staticmethod
    def render_setting_descriptors() -> tuple[Setting, ...]:
        """Every render setting: name, type, default, range and meaning."""
        return tuple(SETTINGS.values())

    # Sprims

    def material(self, material: UsdShade.Material) -> BoundMaterial | None:
        """The scene's material for a prim; None where it has no surface that is supported."""
        key = material.GetPath()
        if key not in self._materials:
            data = read_material(material, self.textures, self._context)
            self._materials[key] = None if data is None else self._new(data)
        return self._materials[key]

    def fallback_material(self, color: Primvar | None) -> BoundMaterial:
        """For what has no material: its displayColor, or grey."""
        if color is None:
            return self.default_material
        if not color.is_constant:
            return self._add_material("displayColor", display_color_material())
        red, green, blue = color.values[color.indices[0] if color.indices is not None else 0].tolist()
        known = self._materials.get((red, green, blue))
        return known or self._add_material((red, green, blue), color_material((red, green, blue)))

    def _add_material(self, key: Any, data: MaterialData) -> BoundMaterial:
        bound = self._materials.get(key)
        if bound is None:
            bound = self._materials[key] = self._new(data)
        return bound

    def _new(self, data: MaterialData) -> BoundMaterial:
        return BoundMaterial(self.scene.add_material(**data.arguments()), data)

    def add_light(self, light: LightData) -> None:
        self.scene.add_light(**light.arguments())

    def set_camera(self, camera: CameraData, width: int, height: int) -> None:
        """The camera, with the film window that the image's shape gives it: pixels are square."""
        half = (camera.half_tangent, camera.half_tangent * height / width)
        near, far = camera.clipping
        self.scene.set_camera(
            camera.path or "camera",
            camera.to_world,
            half,
            centre_tangent=camera.centre_tangent,
            near_clip=near,
            far_clip=far,
            **camera.arguments(),
        )

    # Rprims

    def add_mesh(
        self, data: MeshData, material: BoundMaterial, face_materials: IntArray | None = None
    ) -> int | None:
        """Adds a mesh; None, and a report, where core refuses it."""
        try:
            return int(
                self.scene.add_mesh(
                    **data.arguments(), material=material.index, face_materials=face_materials
                )
            )
        except _core.Error as error:
            message = str(error).removeprefix(f"{data.path}.")
            self._context.reports.error("bad mesh", f"is not rendered: {message}", Sdf.Path(data.path))
            return None

    def bounds(self) -> Gf.Range3d:
        """World bounds of all instances: of their meshes' boxes."""
        scene = self.scene
        boxes = []
        for i in range(scene.prototype_count):
            points = [scene.mesh(m)["points"] for m in scene.prototype(i)["meshes"]]
            low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
            boxes.append(Gf.Range3d(Gf.Vec3d(*low.tolist()), Gf.Vec3d(*high.tolist())))
        bounds = Gf.Range3d()
        for i in range(scene.instance_count):
            placed = scene.instance(i)
            matrix = Gf.Matrix4d(placed["to_world"].tolist())
            bounds.UnionWith(Gf.BBox3d(boxes[placed["prototype"]], matrix).ComputeAlignedRange())
        return bounds

    def add_prototype(self, path: str, meshes: Iterable[int]) -> int:
        return int(self.scene.add_prototype(path, list(meshes)))

    def add_instances(
        self,
        path: str,
        prototype: int,
        matrices: Matrices,
        ids: np.ndarray[Any, np.dtype[np.int64]] | None,
        material: BoundMaterial | None,
        rates: RateArray | None = None,
        motions: Matrices | None = None,
        link_group: int = -1,
    ) -> int:
        """Places a prototype; the index of the first instance.

        material and link_group: replace the meshes' own, where there is one and it is not negative. rates:
        per matrix, theirs where above 0. motions: per matrix, (n, keys, 4, 4) over the shutter.
        """
        index = -1 if material is None else material.index
        more: dict[str, Any] = {}
        if rates is not None:
            more["shading_rates"] = np.ascontiguousarray(rates)
        if motions is not None:
            more["motions"] = np.ascontiguousarray(motions)
        if link_group >= 0:
            more["link_group"] = link_group
        return int(self.scene.add_instances(path, prototype, matrices, ids, index, **more))
