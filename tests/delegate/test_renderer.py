"""The Python interface on tiny stages: arrays, settings, background frames, files and errors."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import encore
import numpy as np
import pytest
from encore import cli
from encore.errors import Cancelled, SettingError, StageError, UsageError
from encore.renderer import Renderer
from pictures import read_exr
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender
from stages import add_material, bind, new_stage
from test_render_thread import until

pytest.importorskip("encore._core")

QUICK: dict[str, Any] = {
    "width": 64,
    "height": 48,
    "samples": 2,
    "light_samples": 1,
    "occlusion_samples": 4,
    "reuse_tile_pixels": 16,
}


def new_scene() -> Usd.Stage:
    """A red card in the upper left quarter of the view, 10 in front of the camera, under a sky."""
    stage = new_stage()
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateHorizontalApertureAttr(40)
    camera.CreateVerticalApertureAttr(30)
    camera.CreateFocalLengthAttr(20)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    card = UsdGeom.Mesh.Define(stage, "/World/Card")
    card.CreatePointsAttr([(-10, 0, -10), (0, 0, -10), (0, 10, -10), (-10, 10, -10)])
    card.CreateFaceVertexCountsAttr([4])
    card.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    card.CreateSubdivisionSchemeAttr("none")
    card.CreateDoubleSidedAttr(True)
    bind(card, add_material(stage, "/World/Red", diffuseColor=(0.5, 0.0, 0.0), roughness=1.0))
    UsdLux.DomeLight.Define(stage, "/World/Sky")
    return stage


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    with Renderer(new_scene(), **QUICK) as made:
        yield made


def equal(a: encore.RenderResult, b: encore.RenderResult) -> bool:
    """Bit for bit, in all AOVs."""
    return set(a) == set(b) and all(a[name].tobytes() == b[name].tobytes() for name in a)


# Arrays.


def test_arrays_by_aov_the_top_row_first(renderer: Renderer) -> None:
    names = ("color", "alpha", "depth", "normal", "direct", "reflection", "refraction")
    image = renderer.render(aovs=names)
    assert tuple(image) == names
    assert (image.width, image.height, len(image)) == (64, 48, len(names))
    shapes = {name: pixels.shape for name, pixels in image.items()}
    assert shapes == {
        "color": (48, 64, 4),
        "alpha": (48, 64),
        "depth": (48, 64),
        "normal": (48, 64, 3),
        "direct": (48, 64, 3),
        "reflection": (48, 64, 3),
        "refraction": (48, 64, 3),
    }
    assert all(pixels.dtype == np.float32 and not pixels.flags.writeable for pixels in image.values())
    # The card is to the upper left.
    assert (image["alpha"][:20, :28] == 1).all()
    assert not image["alpha"][28:].any()
    assert not image["alpha"][:, 36:].any()
    assert image["depth"][:20, :28] == pytest.approx(10, rel=1e-4)
    assert np.isinf(image["depth"][28:]).all()
    assert np.array_equal(image["color"][..., 3], image["alpha"])
    assert np.array_equal(
        image["color"][..., :3], image["direct"] + image["reflection"] + image["refraction"]
    )
    assert not image["refraction"].any(), "nothing in the scene refracts"
    assert (image["color"][:20, :28, 0] > 0).all()


def test_what_is_said_of_a_frame(renderer: Renderer) -> None:
    image = renderer.render()
    assert image.camera == "/Camera"
    assert image.statistics["pixels"] == 64 * 48
    assert image.statistics["antialiasing_samples"] == 4 * 64 * 48
    assert image.statistics["time_s"]["total"] > 0
    assert [report.kind for report in image.reports] == ["camera"]
    assert repr(image) == "<RenderResult 64 x 48: color>"


def test_arrays_stay_what_they_are(renderer: Renderer) -> None:
    first = renderer.render()
    before = first["color"].copy()
    renderer.stage.GetPrimAtPath("/World/Card").SetActive(False)
    renderer.stage.DefinePrim("/World/Ball", "Sphere")
    second = renderer.render()
    assert np.array_equal(first["color"], before)
    assert not np.array_equal(second["color"], before)


def test_equal_frames_are_equal_bit_for_bit(renderer: Renderer) -> None:
    first = renderer.render(aovs=("color", "depth", "normal"))
    assert equal(first, renderer.render(aovs=("color", "depth", "normal")))
    renderer.start(aovs=("color", "depth", "normal"))
    in_background = renderer.wait()
    assert in_background is not None
    assert equal(first, in_background)


# Settings, cameras, times.


def test_settings_by_name(renderer: Renderer) -> None:
    coarse = renderer.render()
    renderer.settings["samples"] = 3
    assert renderer.settings["samples"] == 3
    assert renderer.render().statistics["antialiasing_samples"] == 9 * 64 * 48
    renderer.set(samples=2, width=32, height=None)
    assert renderer.render()["color"].shape == (24, 32, 4), "the camera decides the height"
    renderer.set(width=64, height=48)
    assert equal(renderer.render(), coarse)
    del renderer.settings["samples"]
    assert renderer.settings["samples"] == 8
    assert "seed" in renderer.settings
    assert len(renderer.settings) == len(list(renderer.settings))


def test_render_settings_of_the_stage(renderer: Renderer) -> None:
    settings = UsdRender.Settings.Define(renderer.stage, "/Render/Settings")
    settings.CreateResolutionAttr(Gf.Vec2i(32, 24))
    settings.GetPrim().CreateAttribute("encore:maxBounces", Sdf.ValueTypeNames.Int).Set(1)
    renderer.stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    assert renderer.settings["max_bounces"] == 1
    assert renderer.render().window == (0, 0, 64, 48), "keywords win"
    with Renderer(renderer.stage, samples=1) as other:
        assert other.render().window == (0, 0, 32, 24)
        del other.settings["samples"]
        assert other.settings["samples"] == 8
        settings.CreateDataWindowNDCAttr(Gf.Vec4f(0, 0, 0.5, 1))
        other.set(samples=1, max_bounces=0)
        assert other.render().window == (0, 0, 16, 24)
    with Renderer(renderer.stage, render_settings="none", **QUICK) as plain:
        assert plain.settings["max_bounces"] == 4
    with pytest.raises(StageError, match="/Nowhere"):
        Renderer(renderer.stage, render_settings="/Nowhere")


def test_a_window_holds_the_pixels_of_the_whole(renderer: Renderer) -> None:
    whole = renderer.render(aovs=("color", "depth"))
    part = renderer.render(aovs=("color", "depth"), window=(5, 3, 33, 30))
    assert part.window == (5, 3, 33, 30)
    for name, pixels in part.items():
        assert pixels.shape[:2] == (27, 28)
        assert np.array_equal(pixels, whole[name][3:30, 5:33])
    wider = renderer.render(window=(-4, -2, 70, 50))
    assert np.array_equal(wider["color"][2:50, 4:68], whole["color"])
    assert wider["color"][:2, :20, 3].any(), "the card goes on there"


def test_aovs_that_are_asked_for(renderer: Renderer) -> None:
    stage = renderer.stage
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    UsdGeom.XformCommonAPI(ball).SetTranslate((4, -4, -12))
    card = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Card"))
    card.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [(0, 0), (1, 0), (1, 1), (0, 1)]
    )
    image = renderer.render(
        aovs={
            **{name: {} for name in ("depth", "P", "Peye", "Neye", "primId", "instanceId", "elementId")},
            "primvars:st": {"components": 2},
        }
    )
    empty = np.isinf(image["depth"])
    for name in ("primId", "instanceId", "elementId"):
        assert image[name].dtype == np.int32
        assert image[name].shape == (48, 64)
        assert ((image[name] == -1) == empty).all(), name
    assert len(set(np.unique(image["instanceId"]))) == 3, "nothing, the card and the ball"
    card_pixels = image["instanceId"] == image["instanceId"][5, 5]
    # The camera is at the origin and looks along -Z.
    assert image["P"][card_pixels] == pytest.approx(image["Peye"][card_pixels], abs=1e-4)
    assert image["P"][card_pixels][:, 2] == pytest.approx(-10, rel=1e-4)
    assert -image["Peye"][~empty][:, 2] == pytest.approx(image["depth"][~empty], rel=1e-4)
    assert image["Neye"][5, 5] == pytest.approx((0, 0, 1), abs=1e-4)
    st = image["primvars:st"]
    assert st.shape == (48, 64, 2)
    assert (np.diff(st[5, 2:28, 0]) > 0).all(), "to the right"
    assert (np.diff(st[2:20, 5, 1]) < 0).all(), "upwards, while rows go down"


def test_complexity_is_that_of_the_command_line() -> None:
    assert Renderer(new_scene(), complexity="high").settings["edge_length_scale"] == 0.25


def test_bad_settings_are_named_as_in_python(renderer: Renderer) -> None:
    with pytest.raises(TypeError, match="no setting 'sampels': do you mean 'samples'"):
        Renderer(new_scene(), sampels=3)
    with pytest.raises(SettingError, match=r"^samples: 0 is out of range"):
        Renderer(new_scene(), samples=0)
    with pytest.raises(SettingError, match=r"^shading_rate: "):
        renderer.settings["shading_rate"] = -1
    with pytest.raises(UsageError, match="no such setting"):
        renderer.settings["sampels"] = 1
    with pytest.raises(SettingError, match=r"^search: .*With footprint_reuse metric"):
        renderer.set(footprint_reuse="metric", search="cells")
    with pytest.raises(SettingError, match=r"^shutter_close: .*shutter_open"):
        Renderer(new_scene(), shutter_open=1, shutter_close=0)
    with pytest.raises(UsageError, match=r"^complexity: 'huge' is none"):
        Renderer(new_scene(), complexity="huge")
    with pytest.raises(UsageError, match=r"^purposes: "):
        Renderer(new_scene(), purposes=("final",))


def test_cameras(renderer: Renderer) -> None:
    whole = renderer.render()
    other = UsdGeom.Camera.Define(renderer.stage, "/Other")
    UsdGeom.XformCommonAPI(other).SetRotate((0, 180, 0))
    renderer.camera = "/Other"
    away = renderer.render()
    assert away.camera == "/Other"
    assert not away["color"][..., 3].any()
    renderer.camera = "/Camera"
    assert equal(renderer.render(), whole)
    renderer.camera = "/Nowhere"
    with pytest.raises(StageError, match="/Nowhere"):
        renderer.render()


def test_times(renderer: Renderer) -> None:
    stage = renderer.stage
    stage.SetStartTimeCode(3)
    translate = UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/World/Card"))
    for time, x in ((1, 0.0), (3, 4.0)):
        translate.SetTranslate((x, 0, 0), time)
    renderer.set(samples=1)
    frames = list(renderer.render_frames("1:3"))
    assert [frame.time.GetValue() for frame in frames] == [1, 2, 3]
    right = [int(np.flatnonzero(f["color"][10, :, 3])[-1]) for f in frames]
    assert right[0] < right[1] < right[2]
    assert equal(renderer.render(), frames[2]), "the stage's first time code"
    assert equal(next(renderer.render_frames([1.0])), frames[0])
    assert equal(renderer.render(Usd.TimeCode(2)), frames[1])
    with pytest.raises(UsageError, match=r"^frames: "):
        next(renderer.render_frames("1:x"))


# Background frames.


def test_a_paused_frame_is_what_it_would_have_been(renderer: Renderer) -> None:
    expected = renderer.render(aovs=("color", "depth"))
    renderer.start(aovs=("color", "depth"))
    pauses = 0
    for _ in range(8):
        renderer.pause()
        until(lambda: renderer.delegate.render_thread.is_paused or not renderer.is_rendering)
        if not renderer.is_rendering:
            break
        pauses += 1
        before = renderer.progress
        assert not renderer.buffers["color"].is_converged
        assert renderer.progress == before
        renderer.resume()
    image = renderer.wait()
    assert pauses > 0
    assert image is not None
    assert equal(image, expected)


def test_stop_in_the_middle_leaves_what_is_finished(renderer: Renderer) -> None:
    whole = renderer.render(aovs=("color", "depth"))
    buffers: list[Any] = []

    def stop_after_the_first_rectangle(done: float, stage: str) -> bool:
        buffer = renderer.buffers["color"]
        buffer.resolve()
        buffers.append(buffer)
        return len(buffer.finished_rectangles) < 2

    with pytest.raises(Cancelled):
        renderer.render(aovs=("color", "depth"), progress=stop_after_the_first_rectangle)
    for name, empty in (("color", 0), ("depth", np.inf)):
        buffer = renderer.buffers[name]
        assert not buffer.is_converged
        finished = np.zeros((48, 64), bool)
        with buffer.mapped() as pixels:
            for x0, y0, x1, y1 in buffer.finished_rectangles:
                finished[y0:y1, x0:x1] = True
            assert 0 < finished.sum() < finished.size
            assert np.array_equal(pixels[finished], whole[name][finished])
            assert (pixels[~finished] == empty).all()


def test_stop_in_the_background(renderer: Renderer) -> None:
    renderer.set(samples=8)
    renderer.start()
    renderer.pause()
    until(lambda: renderer.delegate.render_thread.is_paused)
    renderer.stop()
    assert not renderer.is_rendering
    assert renderer.wait() is None
    assert not renderer.buffers["color"].is_converged
    renderer.set(samples=2)
    assert renderer.render().statistics["antialiasing_samples"] == 4 * 64 * 48


def test_the_stage_may_be_edited_while_a_frame_is_rendered(renderer: Renderer) -> None:
    before = renderer.render()
    renderer.start()
    renderer.pause()
    until(lambda: renderer.delegate.render_thread.is_paused)
    renderer.stage.GetPrimAtPath("/World/Red/Surface").GetAttribute("inputs:diffuseColor").Set((0, 1, 0))
    renderer.resume()
    still = renderer.wait()
    assert still is not None
    assert equal(still, before)
    assert (renderer.render()["color"][:20, :28, 1] > 0).all()


def test_what_was_made_can_be_asked_for_while_a_frame_is_paused(renderer: Renderer) -> None:
    renderer.render()
    before = renderer.last_made
    assert before["meshes"] == 1
    renderer.start()
    renderer.pause()
    until(lambda: renderer.delegate.render_thread.is_paused)
    found: list[Any] = []
    # In a thread: so that waiting for the frame fails, and does not last for ever.
    threading.Thread(target=lambda: found.append(renderer.last_made), daemon=True).start()
    until(lambda: bool(found))
    assert found == [before], "the paused frame has not ended"
    renderer.resume()
    assert renderer.wait() is not None
    assert renderer.last_made["meshes"] == 0


def test_a_new_frame_stops_the_one_before(renderer: Renderer) -> None:
    renderer.start()
    renderer.pause()
    first = renderer.buffers["color"]
    image = renderer.render()
    assert not first.is_converged
    assert renderer.buffers["color"].is_converged
    assert image["color"].any()


def test_waiting(renderer: Renderer) -> None:
    with pytest.raises(UsageError, match="nothing has been started"):
        renderer.wait()
    renderer.start()
    renderer.pause()
    with pytest.raises(TimeoutError):
        renderer.wait(0.01)
    renderer.resume()
    image = renderer.wait()
    assert image is not None
    assert renderer.wait() is image


def test_what_fails_in_the_background_surfaces_in_wait(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: Any) -> None:
        raise ZeroDivisionError("in the sink")

    monkeypatch.setattr("encore.aov.pixels", fail)
    renderer.start()
    with pytest.raises(ZeroDivisionError, match="in the sink"):
        renderer.wait()
    with pytest.raises(ZeroDivisionError):
        renderer.render()
    monkeypatch.undo()
    assert renderer.render()["color"].any()


def test_progress_may_cancel(renderer: Renderer) -> None:
    seen: list[float] = []

    def progress(done: float, stage: str) -> bool:
        seen.append(done)
        return len(seen) < 3

    with pytest.raises(Cancelled):
        renderer.render(progress=progress)
    assert len(seen) == 3
    seen.clear()
    renderer.render(progress=lambda done, stage: not seen.append(done))
    assert seen == sorted(seen)
    assert 0 <= seen[0] <= seen[-1] <= 1


def test_an_interrupt_ends_the_frame(renderer: Renderer) -> None:
    expected = renderer.render()

    def interrupt(done: float, stage: str) -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        renderer.render(progress=interrupt)
    with pytest.raises(Cancelled):
        renderer.render(progress=lambda done, stage: not renderer.stop())
    assert not renderer.is_rendering
    assert equal(renderer.render(), expected)


def test_two_renderers_in_two_threads_do_not_disturb_each_other() -> None:
    scenes = [new_scene(), new_scene()]
    scenes[1].GetPrimAtPath("/World/Red/Surface").GetAttribute("inputs:diffuseColor").Set((0, 0, 1))
    alone = [Renderer(scene, **QUICK).render() for scene in scenes]
    together: dict[int, list[encore.RenderResult]] = {0: [], 1: []}

    def work(i: int) -> None:
        with Renderer(scenes[i], **QUICK) as renderer:
            together[i] += [renderer.render() for _ in range(2)]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(2):
        assert [equal(image, alone[i]) for image in together[i]] == [True] * 2


def test_a_program_may_end_while_a_frame_is_paused(tmp_path: Path) -> None:
    new_scene().Export(str(tmp_path / "a.usda"))
    code = f"""
import encore
renderer = encore.Renderer({str(tmp_path / "a.usda")!r}, width=256)
renderer.start()
renderer.pause()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


# Opening and closing.


def test_files_masks_and_session_layers(tmp_path: Path) -> None:
    new_scene().Export(str(tmp_path / "a.usda"))
    session = Usd.Stage.CreateNew(str(tmp_path / "session.usda"))
    session.OverridePrim("/World/Card").SetActive(False)
    session.Save()
    with Renderer(tmp_path / "a.usda", **QUICK) as renderer:
        whole = renderer.render()
        assert whole["color"].any()
    with Renderer(str(tmp_path / "a.usda"), mask=("/Camera", "/World/Card"), **QUICK) as renderer:
        assert not renderer.stage.GetPrimAtPath("/World/Sky")
    with (
        Renderer(tmp_path / "a.usda", session_layer=tmp_path / "session.usda", **QUICK) as renderer,
        pytest.raises(StageError),
    ):
        renderer.render()
    with pytest.raises(StageError, match="no such stage"):
        Renderer(tmp_path / "b.usda")
    with pytest.raises(UsageError, match="mask"):
        Renderer(new_scene(), mask=("/World",))


def test_wrong_aovs(renderer: Renderer) -> None:
    with pytest.raises(UsageError, match="no such AOV"):
        renderer.render(aovs=("colour",))
    with pytest.raises(UsageError, match="nothing has been started"):
        renderer.wait()
    with pytest.raises(UsageError, match=r"^window: "):
        renderer.render(window=(4, 4, 4, 8))
    with pytest.raises(UsageError, match=r"^aovs: 'primvars:st': .*components"):
        renderer.render(aovs={"primvars:st": {"component": 2}})
    with pytest.raises(UsageError, match="no sequence of names"):
        renderer.render(aovs="color")
    with pytest.raises(UsageError, match="no sequence of names"):
        renderer.render(aovs=())


def test_wrong_windows_and_times_leave_the_frame_that_is_rendered(renderer: Renderer) -> None:
    renderer.start()
    renderer.pause()
    wrong: Any
    for wrong in ((0, 0, 3), "abc", (0.0, 0.0, 8.0, 8.0)):
        with pytest.raises(UsageError, match=r"^window: "):
            renderer.render(window=wrong)
    for wrong in (float("nan"), float("inf"), Usd.TimeCode(float("inf")), "1", 10**400):
        with pytest.raises(UsageError, match=r"^time: "):
            renderer.start(wrong)
    assert renderer.is_rendering
    renderer.resume()
    assert renderer.wait() is not None
    default = renderer.render(Usd.TimeCode.Default(), window=[0, 0, 64, 48])  # type: ignore[arg-type]
    assert default.time.IsDefault()
    assert default.window == (0, 0, 64, 48)
    assert renderer.render(np.float32(2)).time == Usd.TimeCode(2)


def test_a_closed_renderer_says_so() -> None:
    with Renderer(new_scene(), **QUICK) as renderer:
        renderer.start()
    assert not renderer.is_rendering
    with pytest.raises(UsageError, match="closed"):
        renderer.render()
    renderer.close()


def test_strictness() -> None:
    stage = new_scene()
    stage.DefinePrim("/World/Broken").GetReferences().AddReference("./nowhere.usda")
    stage.GetPrimAtPath("/World/Card").GetAttribute("faceVertexIndices").Set([0, 1, 2, 9])
    stage.DefinePrim("/World/Ball", "Sphere")
    with pytest.raises(StageError):
        Renderer(stage, strict=True, **QUICK).render()
    reports = Renderer(stage, **QUICK).render().reports
    assert {str(report.path) for report in reports} >= {"/World/Card"}


# Files.


def test_what_is_saved_is_what_the_command_line_writes(tmp_path: Path) -> None:
    new_scene().Export(str(tmp_path / "a.usda"))
    flags = {
        "width": "-w",
        "height": "--imageHeight",
        "samples": "--samples",
        "light_samples": "--lightSamples",
        "occlusion_samples": "--occlusionSamples",
        "reuse_tile_pixels": "--reuseTile",
    }
    arguments = [text for key, flag in flags.items() for text in (flag, str(QUICK[key]))]
    for name in ("record.exr", "record.png"):
        assert cli.main(["record", str(tmp_path / "a.usda"), str(tmp_path / name), "-q", *arguments]) == 0
    with Renderer(tmp_path / "a.usda", **QUICK) as renderer:
        image = renderer.render(aovs=("color", "direct", "depth", "normal"))
    image.save(tmp_path / "a.exr")
    image.save(tmp_path / "a.png")
    header, channels = read_exr(tmp_path / "a.exr")
    expected_header, expected = read_exr(tmp_path / "record.exr")
    assert set(channels) == set(expected)
    for name, pixels in channels.items():
        assert np.array_equal(pixels, expected[name]), name
    for name in ("encore:settings", "encore:camera", "encore:stage", "encore:frame"):
        assert header[name] == expected_header[name]
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "record.png").read_bytes()


def test_wrong_files(renderer: Renderer, tmp_path: Path) -> None:
    image = renderer.render(aovs=("depth",))
    with pytest.raises(UsageError, match="color"):
        image.save(tmp_path / "a.png")
    with pytest.raises(UsageError):
        image.save(tmp_path / "a.tiff")
    with pytest.raises(encore.OutputError):
        image.save(tmp_path / "nowhere" / "a.exr")
    assert list(tmp_path.iterdir()) == []


# The package.


def test_importing_is_light_and_names_come_when_they_are_used() -> None:
    code = """
import sys, encore
heavy = [m for m in sys.modules if m.split(".")[0] in ("OpenImageIO", "numpy", "PyOpenColorIO")]
assert not heavy and "encore._core" not in sys.modules, heavy
assert set(encore.__all__) <= set(dir(encore))
for name in encore.__all__:
    assert getattr(encore, name).__name__ == name
try:
    encore.Renderers
except AttributeError as error:
    assert "Renderers" in str(error)
else:
    raise AssertionError
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ}, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
