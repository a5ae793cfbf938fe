"""Renders translated scenes: one call of core per frame, its errors, and its device."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from pxr import Tf, Usd

from encore.errors import DeviceError, EncoreError, InternalError, MemoryLimitError, StageError, from_core
from encore.settings import SETTINGS, shader_cache_folder

# Called with the share of the frame that is done and the stage at work; False cancels.
ProgressCallback = Callable[[float, str], bool]
# Called with x0, y0 and the images of a rectangle as they become final, in rows from the top: what
# encore._core.render() says of its tiles.
TileSink = Callable[[int, int, dict[str, Any]], None]


def load_core() -> Any:
    """The extension module encore._core. Throws InternalError that says how to build it."""
    try:
        return importlib.import_module("encore._core")
    except ImportError as error:
        raise InternalError(
            f"the renderer itself cannot be loaded ({error})",
            "encore._core",
            "Build it with ./dev or `pip install .`",
        ) from error


class RenderPass:
    """Renders what a RenderIndex has translated, on one device, one frame at a time.

    device: encore._core.Device. cache: encore._core.RenderCache, which makes frames faster by what they share
    with frames before, and changes nothing else. source: the stage's name as the user gave it, for messages.
    """

    def __init__(self, device: Any, cache: Any = None, source: str = "") -> None:
        self.device = device
        self.cache = cache
        self.source = source
        self._core = load_core()

    def execute(
        self,
        translation: Any,
        settings: Mapping[str, Any],
        sink: TileSink,
        progress: ProgressCallback | None = None,
    ) -> dict[str, Any]:
        """Renders, and returns when all is rendered: encore._core.render()'s statistics. Throws EncoreError.

        settings: all of encore.settings; the image's size is the translation's. What sink and progress raise
        ends the frame and is raised here.
        """
        shader_cache = shader_cache_folder(settings["shader_cache"])
        size = {"width": translation.width, "height": translation.height}
        given = {**settings, **size, "shader_cache": shader_cache}
        more = {} if self.cache is None else {"cache": self.cache}
        try:
            result = self._core.render(translation.scene, given, self.device, progress, sink, **more)
        except self._core.Error as error:
            raise core_error(error) from error
        except MemoryError as error:
            raise MemoryLimitError(
                "the machine has no memory left for this frame",
                self.source,
                "Lower --memory, the image size, or the detail of the scene",
            ) from error
        found: dict[str, Any] = result["statistics"]
        return found


def translate(stage: Usd.Stage, time_code: Usd.TimeCode, options: Mapping[str, Any], source: str) -> Any:
    """The stage at a time as encore.render_index.RenderIndex translates it. Throws StageError.

    options: keyword arguments of encore.render_index.SyncOptions, without the time.
    """
    from encore.render_index import RenderIndex, SyncOptions

    return sync(RenderIndex(stage, SyncOptions(time=time_code, **options)), time_code, source)


def sync(index: Any, time_code: Usd.TimeCode, source: str) -> Any:
    """What index.sync() translates: its Translation. Throws StageError. source: the stage, for messages."""
    core = load_core()
    try:
        return index.sync(time_code)
    except core.Error as error:
        raise core_error(error) from error
    except Tf.ErrorException as error:
        raise StageError(f"USD cannot read it: {first_line(error)}", source) from error


def create_device(select: str, disable_gpu: bool) -> Any:
    """The device that --device and --disableGpu ask for. Throws DeviceError."""
    core = load_core()
    try:
        if disable_gpu and not select:
            indices = [i for i, info in enumerate(core.devices()) if info["cpu"]]
            if not indices:
                raise DeviceError(
                    "there is no Vulkan device that runs on the CPU",
                    "--disableGpu",
                    "Install Mesa's lavapipe (Debian: mesa-vulkan-drivers)",
                )
            select = str(indices[0])
        device = core.create_device(select)
    except core.Error as error:
        raise core_error(error) from error
    if disable_gpu and not device.info["cpu"]:
        raise DeviceError(
            f"'{device.info['name']}' is a GPU, and --disableGpu asks for none",
            "--device",
            "Leave one of the two out",
        )
    return device


def core_error(error: Exception) -> EncoreError:
    """The EncoreError of an encore._core.Error; settings are called by their flags."""
    converted = from_core(error)
    if converted.where in SETTINGS:
        return type(converted)(converted.what, SETTINGS[converted.where].flag, converted.remedy)
    return converted


def first_line(error: Exception) -> str:
    """The first line of an exception's text that says something."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
