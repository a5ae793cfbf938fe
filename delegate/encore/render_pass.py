"""One frame: translate the stage at a time, render it to a file, and hand back statistics."""

from __future__ import annotations

import importlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pxr import Tf, Usd

from encore import __version__
from encore.color import DisplayTransform
from encore.errors import (
    Cancelled,
    DeviceError,
    EncoreError,
    InternalError,
    MemoryLimitError,
    StageError,
    from_core,
)
from encore.image_file import ImageInfo, limit_threads
from encore.image_writer import ImageWriter
from encore.settings import SETTINGS, shader_cache_folder

# Called with the share of the frame that is done and the stage at work; False cancels.
ProgressCallback = Callable[[float, str], bool]


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


@dataclass(frozen=True)
class RenderedFrame:
    """What a RenderPass says of a frame. statistics: encore._core.render()'s. reports: the translation's.

    write_s: time that writing took, most of it while the frame was rendered.
    """

    statistics: Mapping[str, Any]
    reports: Any
    camera: str
    sync_s: float
    write_s: float


class RenderPass:
    """Renders frames of a stage with fixed settings on one device.

    sync_options: keyword arguments of encore.render_index.SyncOptions, without the time.
    source: the stage's name as the user gave it, for the header.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        settings: Mapping[str, Any],
        device: Any,
        sync_options: Mapping[str, Any],
        source: str,
    ) -> None:
        self.stage = stage
        self.settings = dict(settings)
        self.shader_cache = shader_cache_folder(settings["shader_cache"])
        self.device = device
        self.sync_options = dict(sync_options)
        self.source = source
        self.core = load_core()
        limit_threads(settings["threads"])

    def render(
        self,
        time_code: Usd.TimeCode,
        label: str,
        output: str,
        transform: DisplayTransform,
        progress: ProgressCallback | None = None,
    ) -> RenderedFrame:
        """Renders the stage at a time to the file `output`, which is written meanwhile. Throws EncoreError.

        label: the frame's name in the header. transform: for PNG.
        """
        started = time.perf_counter()
        translation = translate(self.stage, time_code, self.sync_options, self.source)
        sync_s = time.perf_counter() - started
        settings = self.settings | {"width": translation.width, "height": translation.height}
        info = ImageInfo(
            translation.width,
            translation.height,
            settings["reuse_tile_pixels"],
            self._header(settings, translation, label),
        )
        writer = ImageWriter(output, info, transform)

        def advance(done: float, stage: str) -> bool:
            return not writer.failed and (progress is None or progress(done, stage))

        with writer:
            statistics = self._render(translation.scene, settings, advance, writer)
            if not advance(1.0, "write"):
                raise Cancelled
        return RenderedFrame(statistics, translation.reports, translation.camera_path, sync_s, writer.busy_s)

    def _render(
        self, scene: Any, settings: Mapping[str, Any], progress: ProgressCallback, writer: ImageWriter
    ) -> Any:
        try:
            given = {**settings, "shader_cache": self.shader_cache}
            return self.core.render(scene, given, self.device, progress, writer.add)["statistics"]
        except self.core.Error as error:
            raise core_error(error) from error
        except MemoryError as error:
            raise MemoryLimitError(
                "the machine has no memory left for this frame",
                self.source,
                "Lower --memory, the image size, or the detail of the scene",
            ) from error

    def _header(self, settings: Mapping[str, Any], translation: Any, label: str) -> dict[str, str]:
        """What the image says of its making. Nothing in it differs between two equal runs."""
        # Where shaders are kept is a matter of the machine, and not of the image.
        recorded = {name: value for name, value in settings.items() if name != "shader_cache"}
        opens, closes = translation.shutter
        header = {
            "comments": f"Encore {__version__}, {settings['method']}",
            "encore:version": __version__,
            "encore:method": settings["method"],
            "encore:seed": str(settings["seed"]),
            "encore:settings": json.dumps(recorded, sort_keys=True),
            "encore:stage": self.source,
            "encore:frame": label,
            "encore:camera": translation.camera_path or "automatic",
            "encore:shutter": f"{opens:.9g} {closes:.9g}",
            "encore:motionBlur": "on" if closes > opens else "off",
            "encore:depthOfField": "on" if translation.lens else "off",
            "encore:device": self.device.info["name"],
            "encore:driver": self.device.info["driver"],
            "encore:version:usd": usd_version(),
        }
        versions: Mapping[str, str] = getattr(self.core, "versions", dict)()
        return header | {f"encore:version:{name}": str(version) for name, version in versions.items()}


def translate(stage: Usd.Stage, time_code: Usd.TimeCode, options: Mapping[str, Any], source: str) -> Any:
    """The stage at a time as encore.render_index.RenderIndex translates it. Throws StageError."""
    core = load_core()
    from encore.render_index import RenderIndex, SyncOptions

    try:
        return RenderIndex(stage, SyncOptions(time=time_code, **options)).sync()
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


def usd_version() -> str:
    """USD's version as its releases are called, such as 26.11."""
    major, minor, patch = Usd.GetVersion()
    return f"{minor}.{patch:02d}" if major == 0 else f"{major}.{minor}.{patch}"


def first_line(error: Exception) -> str:
    """The first line of an exception's text that says something."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
