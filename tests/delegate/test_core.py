"""encore._core: arrays in and out, errors, settings, progress, and a frame."""

import gc
from typing import Any

import numpy as np
import pytest
from encore import _core
from encore.image_file import Cursor
from encore.settings import SETTINGS

TRIANGLE = np.array([[-2, -2, -3], [2, -2, -3], [0, 3, -3]], dtype=np.float32)
ONE = np.array([3], dtype=np.int32)
CORNERS = np.array([0, 1, 2], dtype=np.int32)
SMALL = {"width": 24, "height": 16, "samples": 2, "light_samples": 1, "occlusion_samples": 4}


def new_scene() -> _core.Scene:
    """A white triangle before a camera in the origin that looks along -Z, under a white dome."""
    scene = _core.Scene()
    scene.add_material("white", {"diffuse_color": (1.0, 1.0, 1.0), "ior": 1.0, "roughness": 1.0})
    mesh = scene.add_mesh("/Triangle", TRIANGLE, ONE, CORNERS, scheme="none", double_sided=True)
    scene.add_instance("/Triangle", scene.add_prototype("/Triangle", [mesh]), np.eye(4))
    scene.add_light("dome", "/Dome", (1.0, 1.0, 1.0))
    scene.set_camera("/Camera", np.eye(4), (0.75, 0.5))
    return scene


@pytest.fixture(scope="module")
def device() -> _core.Device:
    return _core.create_device()


def test_arrays_are_copied_in_and_out() -> None:
    scene = new_scene()
    points = TRIANGLE.copy()
    index = scene.add_mesh("/M", points, ONE, CORNERS)
    points[:] = 0
    found = scene.mesh(index)["points"]
    np.testing.assert_array_equal(found, TRIANGLE)
    found[:] = 1
    np.testing.assert_array_equal(scene.mesh(index)["points"], TRIANGLE)
    del scene
    gc.collect()
    assert (found == 1).all(), "owns its memory"


def test_matrices_are_usds() -> None:
    scene = new_scene()
    matrices = np.arange(32, dtype=np.float64).reshape(2, 4, 4)
    matrices[:, :, 3] = (0, 0, 0, 1)
    first = scene.add_instances("/I", 0, matrices, np.array([7, 9]))
    for i in range(2):
        found = scene.instance(first + i)
        np.testing.assert_array_equal(found["to_world"], matrices[i])
        assert found["path"] == f"/I[{(7, 9)[i]}]"


def test_shading_rates_of_meshes_and_instances() -> None:
    scene = new_scene()
    mesh = scene.add_mesh("/M", TRIANGLE, ONE, CORNERS, shading_rate=(1.0, 0.25, 256.0))
    assert scene.mesh(mesh)["shading_rate"] == (1, 0.25, 256)
    first = scene.add_instances(
        "/I", 0, np.stack([np.eye(4)] * 2), shading_rates=np.float32([[1, 2, 3], [0, 4, 0]])
    )
    assert [scene.instance(first + i)["shading_rate"] for i in range(2)] == [(1, 2, 3), (0, 4, 0)]
    assert scene.instance(0)["shading_rate"] == (0, 0, 0)
    with pytest.raises(_core.Error, match="shading rates"):
        scene.add_instances("/I", 0, np.eye(4)[None], shading_rates=np.zeros((2, 3), np.float32))
    with pytest.raises(_core.Error) as error:
        scene.add_mesh("/Bad", TRIANGLE, ONE, CORNERS, shading_rate=(1.0, float("nan"), 0.0))
    assert error.value.where == "/Bad.primvars:encore:shadingRate:reflection"


def test_errors_say_what_where_and_what_to_do() -> None:
    scene = new_scene()
    with pytest.raises(_core.Error) as error:
        scene.add_mesh("/Bad", TRIANGLE, ONE, np.array([0, 1, 5], dtype=np.int32))
    assert error.value.kind == "scene"
    assert error.value.where == "/Bad.faceVertexIndices"
    assert error.value.remedy in str(error.value)
    assert scene.mesh_count == 1, "a bad mesh is not added"


@pytest.mark.parametrize(
    ("points", "counts"),
    [
        (TRIANGLE.ravel(), ONE),
        (TRIANGLE[:, :2].copy(), ONE),
        ("points", ONE),
        (TRIANGLE, np.array([[3]], dtype=np.int32)),
    ],
)
def test_arrays_of_the_wrong_shape(points: object, counts: object) -> None:
    with pytest.raises(TypeError):
        new_scene().add_mesh("/Bad", points, counts, CORNERS)  # type: ignore[arg-type]


def test_unknown_names() -> None:
    scene = new_scene()
    with pytest.raises(_core.Error, match="octahedral"):
        scene.add_mesh("/Bad", TRIANGLE, ONE, CORNERS, scheme="octahedral")
    with pytest.raises(_core.Error, match="laser"):
        scene.add_light("laser", "/L", (1.0, 1.0, 1.0))
    with pytest.raises(_core.Error, match="colour"):
        scene.add_material("/M", {"colour": (1.0, 1.0, 1.0)})
    with pytest.raises(IndexError):
        scene.mesh(99)


def test_default_settings_are_those_of_the_package() -> None:
    found = _core.default_settings()
    assert set(SETTINGS) <= set(found)
    for key, setting in SETTINGS.items():
        if setting.default is not None:
            expected = pytest.approx(setting.default) if setting.kind == "float" else setting.default
            assert found[key] == expected, key


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("width", -1),
        ("width", 0),
        ("width", 2.5),
        ("width", True),
        ("seed", 2**40),
        ("lights_visible", 1),
        ("method", "magic"),
        ("filter", "sharp"),
        ("shading_rate", "fast"),
        ("shading_rate", float("nan")),
        ("colour", 1),
    ],
)
def test_bad_settings(key: str, value: object, device: _core.Device) -> None:
    with pytest.raises(_core.Error) as error:
        _core.render(new_scene(), {**SMALL, key: value}, device)
    assert (error.value.kind, error.value.where) == ("setting", key)


def test_a_scene_without_anything(device: _core.Device) -> None:
    with pytest.raises(_core.Error) as error:
        _core.render(_core.Scene(), SMALL, device)
    assert error.value.kind == "scene"


def test_devices() -> None:
    found = _core.devices()
    assert found and {"name", "driver", "cpu", "memory_bytes"} <= found[0].keys()
    assert _core.create_device(found[0]["name"]).info["name"] == found[0]["name"]
    with pytest.raises(_core.Error) as error:
        _core.create_device("no such device")
    assert error.value.kind == "device"


def test_a_frame(device: _core.Device) -> None:
    calls: list[tuple[float, str]] = []

    def progress(done: float, stage: str) -> bool:
        calls.append((done, stage))
        return True

    result = _core.render(
        new_scene(), {**SMALL, "filter": "box", "filter_radius_pixels": 0.5}, device, progress
    )
    assert set(result["layers"]) == {"direct"}
    for name, depth in (("composite", 3), ("normal", 3)):
        assert result[name].shape == (16, 24, depth) and result[name].dtype == np.float32
    assert result["alpha"].shape == result["depth"].shape == (16, 24)
    np.testing.assert_array_equal(result["composite"], result["layers"]["direct"])
    middle = result["composite"][8, 12]
    np.testing.assert_allclose(middle, [1, 1, 1], rtol=0.05)
    assert result["alpha"][8, 12] == 1 and result["alpha"][0, 0] == 0
    assert result["depth"][8, 12] == pytest.approx(3, rel=1e-5) and np.isinf(result["depth"][0, 0])
    np.testing.assert_allclose(np.abs(result["normal"][8, 12]), [0, 0, 1], atol=1e-5)
    statistics = result["statistics"]
    assert statistics["primitives"] == 1 and statistics["pixels"] == 24 * 16
    assert statistics["layers"]["direct"]["shading_evaluations"] > 0
    assert {"trace", "shade", "total"} <= statistics["time_s"].keys()
    shares = [done for done, _ in calls]
    assert shares and shares == sorted(shares) and shares[0] >= 0 and shares[-1] <= 1
    composite = result["composite"]
    before = composite.copy()
    del result
    gc.collect()
    np.testing.assert_array_equal(composite, before)


def test_progress_can_cancel(device: _core.Device) -> None:
    with pytest.raises(_core.Error) as error:
        _core.render(new_scene(), SMALL, device, lambda done, stage: False)
    assert error.value.kind == "cancelled"


def test_what_progress_raises_comes_back(device: _core.Device) -> None:
    def progress(done: float, stage: str) -> bool:
        raise KeyError(stage)

    scene = new_scene()
    with pytest.raises(KeyError):
        _core.render(scene, SMALL, device, progress)
    _core.render(scene, SMALL, device)


TILED = {**SMALL, "width": 52, "height": 40, "reuse_tile_pixels": 16, "debug_aovs": True}


def assembled(parts: list[tuple[int, int, dict[str, Any]]], height: int, width: int) -> dict[str, Any]:
    """Whole images of rectangles; fails unless every pixel came once."""
    times = np.zeros((height, width), int)
    whole: dict[str, Any] = {}

    def place(into: dict[str, Any], images: dict[str, Any], x0: int, y0: int) -> None:
        for key, value in images.items():
            if isinstance(value, dict):
                place(into.setdefault(key, {}), value, x0, y0)
                continue
            rows, columns = value.shape[:2]
            target = into.setdefault(key, np.full((height, width, *value.shape[2:]), -1, np.float32))
            target[y0 : y0 + rows, x0 : x0 + columns] = value

    for x0, y0, images in parts:
        rows, columns = images["alpha"].shape
        times[y0 : y0 + rows, x0 : x0 + columns] += 1
        place(whole, images, x0, y0)
    assert (times == 1).all()
    return whole


def assert_equal_images(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for key, value in one.items():
        if isinstance(value, dict):
            assert_equal_images(value, other[key])
        else:
            np.testing.assert_array_equal(value, other[key], err_msg=key)


@pytest.mark.parametrize("radius", [0.5, 1.5, 8.0])
@pytest.mark.parametrize("method", SETTINGS["method"].choices)
def test_tiles_are_the_whole_image(device: _core.Device, method: str, radius: float) -> None:
    settings = {**TILED, "method": method, "filter_radius_pixels": radius}
    parts: list[tuple[int, int, dict[str, Any]]] = []
    result = _core.render(
        new_scene(), settings, device, tile=lambda x0, y0, images: parts.append((x0, y0, images))
    )
    assert set(result) == {"statistics"}
    gc.collect()
    cursor = Cursor(52, 40)
    for x0, y0, images in parts:
        cursor.advance(x0, y0, *reversed(images["alpha"].shape))
    cursor.require_end()
    assert len(parts) > 1, "pixels are handed out before the last tile"
    whole = _core.render(new_scene(), settings, device)
    del whole["statistics"]
    assert_equal_images(assembled(parts, 40, 52), whole)


def test_what_tile_raises_comes_back(device: _core.Device) -> None:
    calls = []

    def tile(x0: int, y0: int, images: dict[str, Any]) -> None:
        calls.append((x0, y0))
        raise KeyError("disk")

    with pytest.raises(KeyError, match="disk"):
        _core.render(new_scene(), TILED, device, tile=tile)
    assert calls == [(0, 0)]


def test_debug_images_add_up_to_the_statistics(device: _core.Device) -> None:
    settings = {**TILED, "width": 48, "height": 32}
    result = _core.render(new_scene(), settings, device)
    (debug,) = result["debug"].values()
    statistics = result["statistics"]["layers"]["direct"]
    assert debug["evaluations"].sum() == statistics["shading_evaluations"] > 0
    assert {name: debug[name].shape for name in ("reshaded", "distance", "id")} == {
        "reshaded": (32, 48),
        "distance": (32, 48),
        "id": (32, 48, 3),
    }
    assert debug["reshaded"].min() >= 0 and debug["reshaded"].max() <= 1
    empty = result["alpha"] == 0
    assert empty.any() and not debug["evaluations"][empty].all()
    assert "debug" not in _core.render(new_scene(), {**settings, "debug_aovs": False}, device)


def test_versions() -> None:
    assert {"embree", "opensubdiv"} <= _core.versions().keys()


def test_scenes_take_mesh_handles() -> None:
    points = TRIANGLE.copy()
    mesh = _core.Mesh("/M", points, ONE, CORNERS, scheme="none", double_sided=True)
    points[:] = 0
    scene, other = new_scene(), new_scene()
    assert (mesh.path, scene.add_mesh(mesh), other.add_mesh(mesh, 0)) == ("/M", 1, 1)
    materials = np.array([0], dtype=np.int32)
    second = scene.add_mesh(mesh, face_materials=materials, shading_rate=(1.0, 0.0, 2.0), link_group=3)
    found = scene.mesh(second)
    np.testing.assert_array_equal(found["points"], TRIANGLE)
    assert (found["scheme"], found["double_sided"], found["link_group"]) == ("none", True, 3)
    assert (list(found["face_materials"]), found["shading_rate"]) == ([0], (1, 0, 2))
    assert (len(scene.mesh(1)["face_materials"]), scene.mesh(1)["link_group"]) == (0, 0)
    spelled_out = scene.mesh(scene.add_mesh("/M", TRIANGLE, ONE, CORNERS, scheme="none", double_sided=True))
    for name, value in scene.mesh(1).items():
        np.testing.assert_equal(value, spelled_out[name], name)


def test_what_is_wrong_with_a_handle_is_said_once_it_is_known() -> None:
    with pytest.raises(_core.Error) as error:
        _core.Mesh("/Bad", TRIANGLE, ONE, np.array([0, 1, 5], dtype=np.int32))
    assert (error.value.kind, error.value.where) == ("scene", "/Bad.faceVertexIndices")
    scene, mesh = new_scene(), _core.Mesh("/M", TRIANGLE, ONE, CORNERS)
    with pytest.raises(_core.Error) as error:
        scene.add_mesh(mesh, 1)
    assert (error.value.kind, error.value.where) == ("scene", "/M.material:binding")
    with pytest.raises(_core.Error):
        scene.add_mesh(mesh, face_materials=np.array([0, 0], dtype=np.int32))
    with pytest.raises(_core.Error):
        scene.add_mesh(mesh, shading_rate=(-1.0, 0.0, 0.0))
    assert scene.mesh_count == 1, "what is refused is not added"


def test_many_instances_at_once_are_those_one_by_one() -> None:
    one_by_one, at_once = new_scene(), new_scene()
    for scene in (one_by_one, at_once):
        scene.add_prototype("/P", [0])
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 3, 0] = (1, 2, 3)
    rates = np.array([[0, 0, 0], [1, 2, 3], [0, 4, 0]], dtype=np.float32)
    rows = [("/A", 0, -1, -1), ("/B", 1, 0, 2), ("/C", 0, -1, 5)]
    for i, (path, prototype, material, group) in enumerate(rows):
        rate = tuple(rates[i].tolist())
        one_by_one.add_instance(path, prototype, matrices[i], material, rate, None, group)
    paths, prototypes, materials, groups = zip(*rows, strict=True)

    def ints(values: tuple[int, ...]) -> Any:
        return np.array(values, dtype=np.int32)

    first = at_once.add_each_instance(
        list(paths), ints(prototypes), matrices, ints(materials), rates, ints(groups)
    )
    assert first == 1 and at_once.instance_count == 4
    for i in range(4):
        np.testing.assert_equal(at_once.instance(i), one_by_one.instance(i))
    at_once.add_each_instance(["/D"], ints((1,)), matrices[:1])
    assert at_once.instance(4)["material"] == at_once.instance(4)["link_group"] == -1
    with pytest.raises(_core.Error, match="matrices"):
        at_once.add_each_instance(["/E", "/F"], ints((0, 0)), matrices)


class Checker:
    """Pixels of a texture, and how often they were asked for."""

    def __init__(self) -> None:
        self.reads = self.reuses = 0

    def read(self) -> Any:
        self.reads += 1
        pixels = np.zeros((4, 4, 4), dtype=np.float16)
        pixels[::2, ::2] = 1
        return pixels

    def reused(self) -> None:
        self.reuses += 1


def textured_scene(mesh: _core.Mesh, texture: _core.Texture, radiance: float) -> _core.Scene:
    scene = _core.Scene()
    node = {"kind": "texture", "texture": scene.add_texture(texture), "path": "/T", "texcoord": "st"}
    scene.add_material("m", {"diffuse_color": {"value": (0.0, 0.0, 0.0), "node": 0, "channel": 0}}, [node])
    scene.add_instance(mesh.path, scene.add_prototype(mesh.path, [scene.add_mesh(mesh)]), np.eye(4))
    scene.add_light("dome", "/Dome", (radiance, radiance, radiance))
    scene.set_camera("/Camera", np.eye(4), (0.75, 0.5))
    return scene


def test_a_cache_makes_anew_only_what_is_new(device: _core.Device) -> None:
    st = ("st", "vertex", np.array([[0, 0], [1, 0], [0, 1]], dtype=np.float32), None)
    mesh = _core.Mesh("/M", TRIANGLE, ONE, CORNERS, scheme="none", double_sided=True, texcoords=[st])
    checker = Checker()
    texture = _core.Texture("/checker.png", 4, 4, checker.read, checker.reused)
    assert (texture.path, texture.width, texture.height) == ("/checker.png", 4, 4)
    cache = _core.RenderCache()
    _core.render(textured_scene(mesh, texture, 1.0), SMALL, device, cache=cache)
    first, reads = cache.made, checker.reads
    assert (first["meshes"], first["prototypes"]) == (1, 1) and first["kernels"] > 0
    assert reads > 0 and checker.reuses == 0

    scene = textured_scene(mesh, texture, 2.0)
    again = _core.render(scene, SMALL, cache=cache)  # on the cache's device
    assert set(cache.made.values()) == {0}
    assert (checker.reads, checker.reuses) == (reads, 1)
    fresh = _core.render(scene, SMALL, device)
    for result in (again, fresh):
        del result["statistics"]
    assert_equal_images(again, fresh)

    edited = _core.Mesh("/M", TRIANGLE * 0.5, ONE, CORNERS, scheme="none", double_sided=True, texcoords=[st])
    _core.render(textured_scene(edited, texture, 2.0), SMALL, device, cache=cache)
    assert (cache.made["meshes"], cache.held["meshes"], cache.made["textures"]) == (1, 1, 0)


AOVS = [
    {"kind": "position", "name": "P"},
    {"kind": "eyePosition", "name": "Peye"},
    {"kind": "eyeNormal", "name": "Neye"},
    {"kind": "primvar", "name": "rgb", "primvar": "displayColor", "components": 2},
    {"kind": "primId", "name": "primId"},
    {"kind": "instanceId", "name": "instanceId"},
    {"kind": "elementId", "name": "elementId"},
]


def test_a_window_is_a_part_of_the_image_or_reaches_beyond_it(device: _core.Device) -> None:
    whole = _core.render(new_scene(), SMALL | {"window": None}, device)
    part = _core.render(new_scene(), SMALL | {"window": (5, 3, 20, 11)}, device)
    beyond = _core.render(new_scene(), SMALL | {"window": (-7, -2, 30, 19)}, device)
    assert beyond["composite"].shape == (21, 37, 3)
    assert part["statistics"]["pixels"] == 15 * 8
    for name in ("composite", "alpha", "depth", "normal"):
        assert part[name].tobytes() == whole[name][3:11, 5:20].tobytes(), name
        assert beyond[name][2:18, 7:31].tobytes() == whole[name].tobytes(), name


def test_tiles_are_counted_from_the_windows_corner(device: _core.Device) -> None:
    window = {"window": (-20, 3, 12, 30), "reuse_tile_pixels": 16}
    whole = _core.render(new_scene(), SMALL | window, device)
    alpha = np.full((27, 32), -1, dtype=np.float32)

    def tile(x0: int, y0: int, images: dict[str, Any]) -> None:
        height, width = images["alpha"].shape
        assert x0 >= 0 and y0 >= 0 and (alpha[y0 : y0 + height, x0 : x0 + width] == -1).all()
        alpha[y0 : y0 + height, x0 : x0 + width] = images["alpha"]

    _core.render(new_scene(), SMALL | window, device, tile=tile)
    np.testing.assert_array_equal(alpha, whole["alpha"])


def test_aovs(device: _core.Device) -> None:
    images = _core.render(new_scene(), SMALL | {"aovs": AOVS}, device)
    aovs = images["aovs"]
    assert list(aovs) == [aov["name"] for aov in AOVS]
    hit = np.isfinite(images["depth"])
    assert hit.any() and not hit.all()
    for name in ("P", "Peye", "Neye"):
        assert aovs[name].dtype == np.float32 and aovs[name].shape == (16, 24, 3)
    np.testing.assert_allclose(aovs["P"][hit][:, 2], -3, rtol=1e-6)
    np.testing.assert_allclose(aovs["P"], aovs["Peye"], rtol=1e-6)
    assert (aovs["P"][~hit] == 0).all()
    np.testing.assert_allclose(aovs["Neye"][..., 2], images["alpha"], atol=1e-6)
    assert aovs["rgb"].shape == (16, 24, 2) and (aovs["rgb"] == 0).all(), "the triangle has none"
    for name in ("primId", "instanceId", "elementId"):
        assert aovs[name].dtype == np.int32 and aovs[name].shape == (16, 24)
        np.testing.assert_array_equal(aovs[name], np.where(hit, 0, -1))
    assert "aovs" not in _core.render(new_scene(), SMALL, device)


@pytest.mark.parametrize(
    ("settings", "where"),
    [
        ({"window": (0, 0, 4)}, "window"),
        ({"window": (4, 0, 4, 9)}, "window"),
        ({"window": (0, 0, 0, 0)}, "window"),
        ({"window": "all"}, "window"),
        ({"window": (0, 0, 70000, 9)}, "window"),
        ({"aovs": ["P"]}, "aovs"),
        ({"aovs": [{"kind": "position", "name": "P"}, {"kind": "primId", "name": "P"}]}, "aovs"),
        ({"aovs": [{"kind": "colour", "name": "P"}]}, "aovs.kind"),
        ({"aovs": [{"name": "P", "colour": 1}]}, "aovs.colour"),
        ({"aovs": [{"kind": "primvar", "name": "c", "primvar": "c", "components": 5}]}, "aovs"),
        ({"aovs": [{"kind": "primvar", "name": "c", "primvar": "c", "components": -1}]}, "aovs.components"),
    ],
)
def test_bad_windows_and_aovs(settings: dict[str, Any], where: str) -> None:
    with pytest.raises(_core.Error) as error:
        _core.render(new_scene(), SMALL | settings)
    assert (error.value.kind, error.value.where) == ("setting", where)
