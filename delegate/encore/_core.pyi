"""Types of the extension module (core/python); its docstrings say what everything means."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int32]
_Primvar = tuple[str, _Floats, _Ints | None]
_NamedPrimvar = tuple[str, str, _Floats, _Ints | None]
_Triple = tuple[float, float, float]

class Error(Exception):
    kind: str
    where: str
    remedy: str

class Mesh:
    path: str
    def __init__(
        self,
        path: str,
        points: _Floats,
        face_vertex_counts: _Ints,
        face_vertex_indices: _Ints,
        *,
        scheme: str = "catmullClark",
        interpolate_boundary: str = "edgeAndCorner",
        face_varying: str = "cornersPlus1",
        triangle_subdivision: str = "catmullClark",
        left_handed: bool = False,
        double_sided: bool = False,
        hole_indices: _Ints | None = None,
        corner_indices: _Ints | None = None,
        corner_sharpnesses: _Floats | None = None,
        crease_indices: _Ints | None = None,
        crease_lengths: _Ints | None = None,
        crease_sharpnesses: _Floats | None = None,
        normals: _Primvar | None = None,
        display_color: _Primvar | None = None,
        texcoords: Sequence[_NamedPrimvar] = (),
        target_edge_length_world: float = 0.0,
        primvars: Sequence[_NamedPrimvar] = (),
        thin_walled: bool = False,
        motion_points: _Floats | None = None,
        motion_normals: _Floats | None = None,
        shape: str = "faces",
        basis: str = "linear",
        wrap: str = "nonperiodic",
        widths: _Primvar | None = None,
    ) -> None: ...

class Texture:
    path: str
    width: int
    height: int
    def __init__(
        self,
        path: str,
        width: int,
        height: int,
        read: Callable[[], npt.NDArray[np.float16]],
        reused: Callable[[], None] | None = None,
    ) -> None: ...

class Scene:
    def __init__(self) -> None: ...
    @overload
    def add_mesh(
        self,
        mesh: Mesh,
        material: int = 0,
        face_materials: _Ints | None = None,
        shading_rate: _Triple = ...,
        link_group: int = 0,
    ) -> int: ...
    @overload
    def add_mesh(self, path: str, points: _Floats, *arguments: _Ints, **keywords: Any) -> int: ...
    def add_prototype(self, path: str, meshes: Sequence[int]) -> int: ...
    def add_instance(
        self,
        path: str,
        prototype: int,
        matrix: _Doubles,
        material: int = -1,
        shading_rate: _Triple = ...,
        motion: _Doubles | None = None,
        link_group: int = -1,
    ) -> int: ...
    def add_instances(
        self,
        path: str,
        prototype: int,
        matrices: _Doubles,
        ids: npt.NDArray[np.int64] | None = None,
        material: int = -1,
        shading_rates: _Floats | None = None,
        motions: _Doubles | None = None,
        link_group: int = -1,
        primvars: Sequence[tuple[str, bool, _Floats]] = (),
    ) -> int: ...
    def add_each_instance(
        self,
        paths: Sequence[str],
        prototypes: _Ints,
        matrices: _Doubles,
        materials: _Ints | None = None,
        shading_rates: _Floats | None = None,
        link_groups: _Ints | None = None,
    ) -> int: ...
    @overload
    def add_texture(self, texture: Texture) -> int: ...
    @overload
    def add_texture(self, path: str, pixels: _Floats) -> int: ...
    def add_texture_source(
        self, path: str, width: int, height: int, read: Callable[[], npt.NDArray[np.float16]]
    ) -> int: ...
    def add_material(
        self,
        path: str,
        inputs: Mapping[str, Any] = ...,
        nodes: Sequence[Mapping[str, Any]] = ...,
        use_specular_workflow: bool = False,
        opacity_threshold: float = 0.0,
        *,
        opacity_mode: str = "transparent",
        dielectric_priority: int = 0,
        surface_shader: dict[str, Any] | None = None,
        displacement_shader: dict[str, Any] | None = None,
    ) -> int: ...
    def add_light(
        self,
        kind: str,
        path: str,
        radiance: _Triple,
        **fields: Any,
    ) -> int: ...
    def set_camera(
        self,
        path: str,
        matrix: _Doubles,
        half_tangent: tuple[float, float],
        **fields: Any,
    ) -> None: ...
    @property
    def mesh_count(self) -> int: ...
    @property
    def prototype_count(self) -> int: ...
    @property
    def instance_count(self) -> int: ...
    @property
    def texture_count(self) -> int: ...
    @property
    def material_count(self) -> int: ...
    @property
    def light_count(self) -> int: ...
    def mesh(self, index: int) -> dict[str, Any]: ...
    def prototype(self, index: int) -> dict[str, Any]: ...
    def instance(self, index: int) -> dict[str, Any]: ...
    def texture(self, index: int) -> dict[str, Any]: ...
    def material(self, index: int) -> dict[str, Any]: ...
    def light(self, index: int) -> dict[str, Any]: ...
    @property
    def camera(self) -> dict[str, Any]: ...
    def validate(self) -> None: ...

class Device:
    @property
    def info(self) -> dict[str, Any]: ...

def devices() -> list[dict[str, Any]]: ...
def create_device(select: str = "", validation: bool = False) -> Device: ...
def default_settings() -> dict[str, Any]: ...
def versions() -> dict[str, str]: ...

class RenderCache:
    def __init__(self) -> None: ...
    @property
    def made(self) -> dict[str, int]: ...
    @property
    def held(self) -> dict[str, int]: ...

def render(
    scene: Scene,
    settings: Mapping[str, Any],
    device: Device | None = None,
    progress: Callable[[float, str], bool] | None = None,
    tile: Callable[[int, int, dict[str, Any]], None] | None = None,
    cache: RenderCache | None = None,
) -> dict[str, Any]: ...
def trace_raw(scene: Scene, settings: Mapping[str, Any]) -> dict[str, Any]: ...
