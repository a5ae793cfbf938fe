"""The delegate as a host sees it: types, settings and their version, buffers, statistics."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from encore import render_delegate, render_pass
from encore.adapters import implicit, light
from encore.errors import DeviceError, ExitCode, MemoryLimitError, SettingError, UsageError
from encore.readers import READERS
from encore.render_buffer import AovBinding, Format
from encore.render_delegate import RenderDelegate
from encore.render_pass import RenderPass
from encore.render_thread import Job
from encore.settings import SETTINGS


class CoreError(Exception):
    def __init__(self, kind: str) -> None:
        super().__init__("failed")
        self.kind, self.where, self.remedy = kind, "", ""


class Core:
    """Stands in for encore._core: an image of two rectangles, and what may go wrong between them."""

    Error = CoreError
    RenderCache = SimpleNamespace

    def __init__(self) -> None:
        self.error: Exception | None = None
        self.calls: list[tuple[Any, dict[str, Any], Any, Any]] = []

    def create_device(self, select: str) -> Any:
        return SimpleNamespace(info={"name": f"device {select}", "cpu": True})

    def render(
        self, scene: Any, settings: dict[str, Any], device: Any, progress: Any, tile: Any, cache: Any = None
    ) -> Any:
        self.calls.append((scene, settings, device, cache))
        for done, x0 in ((0.0, 0), (0.5, 2)):
            if not progress(done, "render"):
                raise CoreError("cancelled")
            rgb = np.full((1, 2, 3), x0, np.float32)
            tile(x0, 0, {"composite": rgb, "alpha": np.ones((1, 2), np.float32), "layers": {}})
            if self.error:
                raise self.error
        return {"statistics": {"time_s": {"dice": 1.0, "build": 0.5}}}


@pytest.fixture
def core(monkeypatch: pytest.MonkeyPatch) -> Core:
    made = Core()
    monkeypatch.setattr(render_pass, "load_core", lambda: made)
    monkeypatch.setattr(render_delegate, "load_core", lambda: made)
    return made


class Index:
    """Stands in for a RenderIndex."""

    def __init__(self) -> None:
        self.times: list[Any] = []

    def sync(self, time: Any) -> Any:
        self.times.append(time)
        return SimpleNamespace(scene="scene", width=4, height=1)


def test_types_go_by_hydras_names() -> None:
    # Implicit shapes are meshes.
    read = {f"{name[0].lower()}{name[1:]}" for name in READERS} - {
        f"{name[0].lower()}{name[1:]}" for name in implicit.TYPES
    }
    assert read == set(RenderDelegate.SUPPORTED_RPRIM_TYPES)
    assert {"camera", "material"} <= set(RenderDelegate.SUPPORTED_SPRIM_TYPES)
    for name in light.TYPES:
        hydra = name.removesuffix("_1")
        assert hydra[0].lower() + hydra[1:] in RenderDelegate.SUPPORTED_SPRIM_TYPES
    assert "renderBuffer" in RenderDelegate.SUPPORTED_BPRIM_TYPES
    delegate = RenderDelegate()
    assert delegate.material_render_contexts == ("encore", "")
    assert delegate.shader_source_types == ("glsl",)
    assert delegate.is_pause_supported
    assert delegate.is_stop_supported


def test_setting_descriptors() -> None:
    found = {d.key: d for d in RenderDelegate.render_setting_descriptors()}
    assert list(found) == list(SETTINGS)
    samples = found["samples"]
    assert (samples.name, samples.default_value, samples.kind) == ("Samples", 8, "int")
    assert samples.range == "at least 1, at most 64"
    assert "samples" in samples.doc


def test_settings_and_their_version() -> None:
    delegate = RenderDelegate({"samples": 4})
    assert delegate.get_render_setting("samples") == 4
    version = delegate.render_settings_version
    delegate.set_render_setting("samples", 4)
    assert delegate.render_settings_version == version, "nothing has changed"
    delegate.set_render_setting("samples", 2)
    assert delegate.render_settings_version == version + 1
    delegate.set_render_setting("samples", None)
    assert delegate.get_render_setting("samples") == 8
    with pytest.raises(SettingError):
        delegate.set_render_settings({"seed": 3, "samples": 0})
    assert delegate.get_render_setting("seed") == 0, "all or nothing"
    with pytest.raises(UsageError, match="no such setting"):
        delegate.set_render_setting("sampels", 1)
    with pytest.raises(UsageError, match="no such setting"):
        delegate.get_render_setting("sampels")
    with pytest.raises(SettingError):
        RenderDelegate({"samples": 0})


def test_aov_descriptors() -> None:
    color = RenderDelegate.get_default_aov_descriptor("color")
    assert (color.format, color.multi_sampled) == (Format.FLOAT32_VEC4, True)
    ids = RenderDelegate.get_default_aov_descriptor("primId")
    assert (ids.format, ids.multi_sampled, ids.clear_value) == (Format.INT32, False, -1)


def test_a_frame_in_hydras_order(core: Core) -> None:
    delegate = RenderDelegate({"seed": 5}, select="x")
    with pytest.raises(UsageError, match="commit_resources"):
        delegate.start([])
    index: Any = Index()
    delegate.commit_resources(index, 7)
    assert index.times == [7]
    buffer = delegate.create_render_buffer("/color")
    bindings = [AovBinding("color", buffer)]
    assert delegate.execute(bindings)
    assert buffer.is_converged
    assert buffer.map()[0, :, 0].tolist() == [0, 0, 2, 2]
    buffer.unmap()
    scene, settings, device, cache = core.calls[0]
    assert scene == "scene"
    assert (settings["seed"], settings["width"], settings["height"]) == (5, 4, 1)
    assert device.info["name"] == "device x"
    delegate.set_render_setting("seed", 6)
    delegate.restart()
    assert delegate.render_thread.wait()
    assert core.calls[1][1]["seed"] == 6
    assert core.calls[1][2] is device
    assert core.calls[1][3] is cache
    delegate.release()
    assert delegate.is_stopped


@pytest.mark.parametrize("begin", ["start", "execute"])
def test_a_frame_that_is_refused_leaves_the_one_that_is_rendered(core: Core, begin: str) -> None:
    delegate = RenderDelegate()
    index: Any = Index()
    delegate.commit_resources(index, 1)
    bindings = [AovBinding("color", delegate.create_render_buffer())]
    other = [AovBinding("alpha", delegate.create_render_buffer())]

    def progress(done: float, stage: str) -> bool:
        for again in (bindings, other):
            with pytest.raises(UsageError, match="being rendered"):
                getattr(delegate, begin)(again, (1, 0, 3, 1))
        return True

    assert delegate.execute(bindings, progress=progress)
    with bindings[0].render_buffer.mapped() as pixels:
        assert pixels[..., 0].tolist() == [[0, 0, 2, 2]]
        assert pixels[..., 3].tolist() == [[1, 1, 1, 1]]
    assert delegate.statistics is not None
    assert other[0].render_buffer.width == 0, "nothing was allocated"
    delegate.restart()
    assert delegate.render_thread.wait()
    assert other[0].render_buffer.width == 0
    assert "window" not in core.calls[1][1]


def test_a_frame_renders_into_its_own_buffers(core: Core, monkeypatch: pytest.MonkeyPatch) -> None:
    delegate = RenderDelegate()
    index: Any = Index()
    delegate.commit_resources(index, 1)
    jobs: list[Job] = []

    def start(job: Job, prepare: Callable[[], None]) -> None:
        prepare()
        jobs.append(job)

    # Threads that begin late.
    monkeypatch.setattr(delegate.render_thread, "start", start)
    buffers = [delegate.create_render_buffer() for _ in range(2)]
    for buffer in buffers:
        delegate.start([AovBinding("color", buffer)])
    jobs[0](lambda *at: True)
    assert [buffer.is_converged for buffer in buffers] == [True, False]


def test_buffers_that_cannot_be_had_are_no_frame(core: Core) -> None:
    delegate = RenderDelegate()
    index: Any = Index()
    delegate.commit_resources(index, 1)
    color, alpha = (AovBinding(name, delegate.create_render_buffer(name)) for name in ("color", "alpha"))
    delegate.execute([color])
    with alpha.render_buffer.mapped(), pytest.raises(UsageError, match="mapped"):
        delegate.start([alpha])
    for wrong in ([color, AovBinding("P", alpha.render_buffer, clear_value="x")], [color, alpha, alpha]):
        with pytest.raises(UsageError, match="aovs"):
            delegate.start(wrong)
    with pytest.raises(UsageError, match="window"):
        delegate.start([color], (0, 0, 0, 1))
    assert color.render_buffer.is_converged, "it was not cleared"
    assert delegate.is_stopped
    assert delegate.execute([alpha])


def test_statistics_by_the_names_that_hosts_look_for(core: Core) -> None:
    delegate = RenderDelegate()
    stats = delegate.get_render_stats()
    assert stats["percentDone"] == stats["fractionDone"] == stats["totalClockTime"] == 0
    index: Any = Index()
    delegate.commit_resources(index, 1)
    seen = []

    def progress(done: float, stage: str) -> bool:
        seen.append(delegate.get_render_stats())
        return True

    delegate.execute([AovBinding("color", delegate.create_render_buffer())], progress=progress)
    assert [s["percentDone"] for s in seen] == [0, 50]
    assert seen[1]["renderProgressAnnotation"] == "render"
    stats = delegate.get_render_stats()
    assert stats["percentDone"] == 100 * stats["fractionDone"] == 100
    assert stats["loadClockTime"] == 1.5
    assert stats["totalClockTime"] > 0
    assert 0 < stats["totalMemory"] <= stats["peakMemory"]
    assert stats["rendererName"] == "Encore"
    assert stats["huskErrorStatus"] == 0


@pytest.mark.parametrize(
    ("raised", "expected", "status"),
    [
        (CoreError("device"), DeviceError, ExitCode.DEVICE),
        (CoreError("memory"), MemoryLimitError, ExitCode.MEMORY),
        (MemoryError(), MemoryLimitError, ExitCode.MEMORY),
        (KeyError("x"), KeyError, ExitCode.INTERNAL),
    ],
)
def test_a_frame_that_fails(
    core: Core, raised: Exception, expected: type[Exception], status: ExitCode
) -> None:
    core.error = raised
    delegate = RenderDelegate()
    index: Any = Index()
    delegate.commit_resources(index, 1)
    buffer = delegate.create_render_buffer()
    delegate.start([AovBinding("color", buffer)])
    with pytest.raises(expected):
        delegate.render_thread.wait()
    assert not buffer.is_converged
    assert delegate.statistics is None
    assert delegate.get_render_stats()["huskErrorStatus"] == status
    assert delegate.get_render_stats()["percentDone"] < 100


def test_a_sink_that_fails_is_what_is_raised(core: Core) -> None:
    def sink(x0: int, y0: int, images: dict[str, Any]) -> None:
        raise ZeroDivisionError

    translation = SimpleNamespace(scene=None, width=4, height=1)
    with pytest.raises(ZeroDivisionError):
        RenderPass(None).execute(translation, RenderDelegate().render_settings, sink, lambda *at: True)
