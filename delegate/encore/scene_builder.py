"""The scene under construction: takes what the adapters read, and fills an encore._core.Scene with it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pxr import Gf, Sdf

from encore import _core
from encore.adapters.camera import CameraData, Film
from encore.adapters.context import Matrix, SyncContext
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.instancer import Matrices
from encore.adapters.light import LightData
from encore.adapters.mesh import MeshData
from encore.adapters.primvars import IntArray
from encore.adapters.shading_rate import NO_RATES, RateArray
from encore.adapters.texture import Textures
from encore.materials import BoundMaterial, Materials


class PreparedMesh:
    """A mesh that is handed over to core once, and taken by the scenes of many frames.

    handle: encore._core.Mesh, made when first needed. error: why core refuses it. placed: the same mesh in
    other spaces, by matrix.
    """

    __slots__ = ("data", "error", "handle", "placed")

    def __init__(self, data: MeshData) -> None:
        self.data = data
        self.handle: Any = None
        self.error = ""
        self.placed: dict[bytes, PreparedMesh] = {}

    def transformed(self, matrix: Matrix) -> PreparedMesh:
        """In another space: the last one is kept."""
        key = matrix.tobytes()
        if key not in self.placed:
            self.placed = {key: PreparedMesh(self.data.transformed(matrix))}
        return self.placed[key]

    def prepare(self) -> Any:
        """The handle; None where core refuses it."""
        if self.handle is None and not self.error:
            try:
                self.handle = _core.Mesh(**self.data.arguments())
            except _core.Error as error:
                self.error = str(error)
        return self.handle


class SceneBuilder:
    """Fills an encore._core.Scene with rprims, sprims and bprims, in the order given.

    Materials and textures are added where they are first used.
    """

    def __init__(self, materials: Materials, textures: Textures, context: SyncContext) -> None:
        self.scene = _core.Scene()
        self._context = context
        self._texture_handles = textures
        self._materials: dict[BoundMaterial, int] = {}
        self._textures: dict[int, int] = {}
        self._single: list[tuple[str, int, Matrix, int, int]] = []  # instances that wait for flush()
        self.material(materials.default)

    # Bprims and sprims

    def texture(self, index: int) -> int:
        """The scene's index of one of Textures."""
        found = self._textures.get(index)
        if found is None:
            handle = self._texture_handles.handle(index)
            found = self._textures[index] = int(self.scene.add_texture(handle))
        return found

    def material(self, material: BoundMaterial) -> int:
        """The scene's index of a material."""
        found = self._materials.get(material)
        if found is None:
            textures = {t: self.texture(t) for t in material.textures}
            index = int(self.scene.add_material(**material.data.arguments(textures)))
            found = self._materials[material] = index
        return found

    def add_light(self, light: LightData) -> None:
        texture = self.texture(light.texture) if light.texture >= 0 else -1
        self.scene.add_light(**light.arguments(texture))

    # Rprims

    def add_mesh(
        self,
        mesh: PreparedMesh,
        material: BoundMaterial,
        face_materials: IntArray | None = None,
        of_faces: Sequence[BoundMaterial] = (),
        *,
        own_rates: bool = True,
    ) -> int | None:
        """Adds a mesh; None, and a report, where core refuses it.

        face_materials: per face which one of of_faces, -1: material. own_rates: whether it keeps its shading
        rates.
        """
        data = mesh.data
        more: dict[str, Any] = {}
        if own_rates and data.shading_rate != NO_RATES:
            more["shading_rate"] = data.shading_rate
        if data.link_group:
            more["link_group"] = data.link_group
        index = self.material(material)
        if face_materials is not None:
            table = np.array([*(self.material(m) for m in of_faces), -1], np.int32)
            more["face_materials"] = table[face_materials]
        handle, error = mesh.prepare(), mesh.error
        if handle is not None:
            try:
                return int(self.scene.add_mesh(handle, index, **more))
            except _core.Error as refused:
                error = str(refused)
        message = error.removeprefix(f"{data.path}.")
        self._context.reports.error("bad mesh", f"is not rendered: {message}", Sdf.Path(data.path))
        return None

    def bounds(self) -> Gf.Range3d:
        """World bounds of all instances: of their meshes' boxes."""
        self.flush()
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

    def add_single(
        self,
        path: str,
        prototype: int,
        matrix: Matrix,
        material: BoundMaterial | None = None,
        link_group: int = -1,
    ) -> None:
        """Places a prototype once, by flush() at the latest: as add_instances(), but fast for many."""
        index = -1 if material is None else self.material(material)
        self._single.append((path, prototype, matrix, index, link_group))

    def flush(self) -> None:
        """Places what add_single() was given."""
        if not self._single:
            return
        paths, prototypes, matrices, materials, groups = zip(*self._single, strict=True)
        self._single.clear()
        self.scene.add_each_instance(
            list(paths),
            np.array(prototypes, np.int32),
            np.ascontiguousarray(np.stack(matrices)),
            np.array(materials, np.int32),
            None,
            np.array(groups, np.int32),
        )

    @property
    def instance_count(self) -> int:
        """Of all that has been placed."""
        return int(self.scene.instance_count) + len(self._single)

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
        primvars: InstancePrimvars | None = None,
    ) -> int:
        """Places a prototype; the index of the first instance.

        material and link_group: replace the meshes' own, where there is one and it is not negative. rates:
        per matrix, theirs where above 0. motions: per matrix, (n, keys, 4, 4) over the shutter. primvars: per
        matrix, by name.
        """
        index = -1 if material is None else self.material(material)
        self.flush()
        more: dict[str, Any] = {}
        if rates is not None:
            more["shading_rates"] = np.ascontiguousarray(rates)
        if motions is not None:
            more["motions"] = np.ascontiguousarray(motions)
        if link_group >= 0:
            more["link_group"] = link_group
        if primvars:
            more["primvars"] = [
                (name, p.wins, np.ascontiguousarray(p.values)) for name, p in sorted(primvars.items())
            ]
        return int(self.scene.add_instances(path, prototype, matrices, ids, index, **more))


def set_camera(scene: Any, camera: CameraData, film: Film) -> None:
    """Gives an encore._core.Scene its camera, in place of one that it may have."""
    near, far = camera.clipping
    scene.set_camera(
        camera.path or "camera",
        camera.to_world,
        film.half_tangents,
        centre_tangent=camera.centre_tangent,
        near_clip=near,
        far_clip=far,
        **camera.arguments(),
    )
