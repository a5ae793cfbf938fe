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
