"""encore._core: arrays in and out, errors, settings, progress, and a frame."""

import gc

import numpy as np
import pytest
from encore import _core
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


def test_versions() -> None:
    assert {"embree", "opensubdiv"} <= _core.versions().keys()
