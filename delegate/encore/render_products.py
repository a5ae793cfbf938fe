"""What a run renders: for every frame the renders that it takes, and the files that are written of each.

Flags win over what prims of the stage say, those over the defaults. Products that differ in no more than what
they hold are files of one render.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pxr import Usd

from encore import record_options
from encore.active_pass import activate_pass, read_pass
from encore.adapters.camera import FilmOptions
from encore.errors import SettingError, UsageError
from encore.frames import Frame, expand_product_name, plan, times
from encore.output import FORMATS, check_format
from encore.record_options import RecordOptions, given_flags, refined
from encore.render_settings import (
    LARGEST_SIDE,
    Product,
    RenderSpec,
    data_window,
    find_settings,
    read_settings,
)
from encore.render_vars import Aov, Selection, select
from encore.report import Reports
from encore.settings import resolve
from encore.working_space import WorkingSpace, working_space

Window = tuple[int, int, int, int]
# An OUTPUT that leaves the names of files to products: they are relative to the current folder.
PRODUCT_NAMES = "-"


@dataclass(frozen=True)
class OutputFile:
    """An image to write. product: prim path, or empty. selection: its channels; None: all that there are."""

    path: str
    product: str = ""
    selection: Selection | None = None
    space: WorkingSpace = field(default_factory=WorkingSpace)

    def header(self) -> dict[str, str]:
        """What the file says of its product."""
        if not self.product:
            return {}
        found = {"encore:renderProduct": self.product}
        if self.selection is not None:
            names = {channel.var: " ".join(channel.names) for channel in self.selection.channels}
            found["encore:renderVars"] = json.dumps(names)
        return found


@dataclass(frozen=True)
class Render:
    """One render of a frame. sync: keyword arguments of SyncOptions, without time and film.

    settings: all of encore.settings. window: the pixels that are rendered, y down; None: the image.
    source: what headers and statistics say of where this comes from.
    """

    sync: Mapping[str, Any]
    film: FilmOptions
    settings: Mapping[str, Any]
    window: Window | None = None
    files: tuple[OutputFile, ...] = ()
    source: Mapping[str, str] = field(default_factory=dict)

    @property
    def aovs(self) -> tuple[Aov, ...]:
        """What its files hold besides layers, alpha, depth and normals, each once."""
        found = {a.name: a for f in self.files if f.selection is not None for a in f.selection.aovs}
        return tuple(found.values())

    def sync_options(self) -> dict[str, Any]:
        """Keyword arguments of SyncOptions, without the time."""
        film = self.film
        return {
            **self.sync,
            "width": film.width,
            "height": film.height,
            "pixel_aspect_ratio": film.pixel_aspect_ratio,
            "conform_policy": film.conform_policy,
        }

    def is_rendered_with(self, other: Render) -> bool:
        """Whether the files of both can be written of one render."""
        return replace(self, files=(), source={}) == replace(other, files=(), source={})


@dataclass(frozen=True)
class FrameJob:
    """A frame to make. label: what logs, headers and statistics call it."""

    time: Usd.TimeCode
    label: str
    renders: tuple[Render, ...]


def plan_run(options: RecordOptions, stage: Usd.Stage, reports: Reports) -> list[FrameJob]:
    """Everything that the run will do. A render pass changes the stage.

    Throws UsageError, SettingError and StageError.
    """
    settings, source = _active_settings(options, stage, reports)
    if settings is None:
        settled = settled_settings(options, {})
        render = Render(sync_options(options), _film(settled), settled)
        check_format(options.output)
        return [
            FrameJob(f.time, f.label, (replace(render, files=(OutputFile(f.output),)),))
            for f in plan(stage, options.output, options.frames, options.default_time)
        ]
    source["encore:flags"] = json.dumps(given_flags(options))
    jobs = []
    outputs = _Outputs(options, stage)
    for index, frame in enumerate(times(stage, options.frames, options.default_time)):
        spec = read_settings(settings, frame.time, reports)
        space = working_space(spec.color_space, spec.path, reports)
        named = [
            (product, _file(product, outputs.path(spec, number, index, frame), space, reports))
            for number, product in enumerate(spec.products)
        ]
        jobs.append(FrameJob(frame.time, frame.label, _renders(options, spec, named, source)))
    return jobs


def plan_first(options: RecordOptions, stage: Usd.Stage, time: Usd.TimeCode, reports: Reports) -> Render:
    """The first render of a frame, without its files. Throws as plan_run(), and changes the stage as it."""
    settings, source = _active_settings(options, stage, reports)
    if settings is None:
        settled = settled_settings(options, {})
        return Render(sync_options(options), _film(settled), settled)
    spec = read_settings(settings, time, reports)
    product = spec.products[0]
    file = OutputFile("", product.path, select(product, reports))
    return _renders(options, spec, [(product, file)], source)[0]


def settled_settings(options: RecordOptions, authored: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """All settings: the flags' over the authored ones over the defaults. path: of what authors them."""
    refined(options.complexity, resolve(options.settings))  # flags that are wrong by themselves
    try:
        return refined(options.complexity, resolve({**authored, **options.settings}))
    except SettingError as error:
        if not authored:
            raise
        raise SettingError(f"with {error.where}, {error.what}", path, error.remedy) from None


def sync_options(options: RecordOptions) -> dict[str, Any]:
    """What flags say of the translation, as keyword arguments of SyncOptions, without the film."""
    found = record_options.sync_options(options, {"width": 0, "height": None})
    return {name: value for name, value in found.items() if name not in ("width", "height")}


def _film(settings: Mapping[str, Any]) -> FilmOptions:
    return FilmOptions(settings["width"], settings["height"])


def _active_settings(
    options: RecordOptions, stage: Usd.Stage, reports: Reports
) -> tuple[Any, dict[str, str]]:
    """The RenderSettings that are rendered, or None, and what headers say of them. Prunes for a pass."""
    if options.render_pass and options.render_settings:
        raise UsageError(
            "contradicts --renderSettingsPrimPath", "--renderPassPrimPath", "Leave one of the two out"
        )
    path, source = options.render_settings, {}
    if options.render_pass:
        path = read_pass(stage, options.render_pass, reports).settings
        source["encore:renderPass"] = options.render_pass
        activate_pass(stage, options.render_pass, reports)
    settings = find_settings(stage, path, reports)
    if settings is not None:
        source["encore:renderSettings"] = str(settings.GetPath())
    return settings, source


class _Outputs:
    """Where products are written: OUTPUT names a folder for them, `-`, or files, one for each."""

    def __init__(self, options: RecordOptions, stage: Usd.Stage) -> None:
        self._options = options
        self._stage = stage
        output = options.output
        self._folder: Path | None = None
        if output == PRODUCT_NAMES:
            self._folder = Path()
        elif output.endswith("/") or Path(output).is_dir():
            self._folder = Path(output)
        self._frames: list[list[Frame]] = []  # by product, of names that OUTPUT gives
        self._used: dict[str, tuple[str, str]] = {}  # file, however named → product and frame

    def path(self, spec: RenderSpec, number: int, index: int, frame: Frame) -> str:
        """The file of a product (its number) at a frame (its index). Throws for a name of no use."""
        product = spec.products[number]
        if self._folder is not None:
            name = self._product_name(spec, product, frame)
        else:
            name = self._given(spec)[number][index].output
            check_format(name)
        other = self._used.setdefault(os.path.realpath(name), (product.path, frame.label))
        if other != (product.path, frame.label):
            where = f"{product.path}.productName" if self._folder is not None else "OUTPUT"
            same = (
                f"frames {other[1]} and {frame.label}" if other[0] == product.path else f"{other[0]} and it"
            )
            raise SettingError(
                f"{same} would both be written to {name}",
                where,
                "Put a placeholder such as <F4> or #### into the name, or give it time samples",
            )
        return name

    def _product_name(self, spec: RenderSpec, product: Product, frame: Frame) -> str:
        assert self._folder is not None
        if not product.path:
            raise UsageError(
                f"{spec.path} has no products, whose names would be used",
                "OUTPUT",
                "Give the name of an image",
            )
        where = f"{product.path}.productName"
        if not product.name:
            raise SettingError("it is empty", where, "Name the image, such as beauty.<F4>.exr")
        if Path(product.name).suffix.lower() not in FORMATS:
            raise SettingError(
                f"'{product.name}' is no image that can be written", where, f"Use {' or '.join(FORMATS)}"
            )
        return str(self._folder / expand_product_name(product.name, frame.time, where))

    def _given(self, spec: RenderSpec) -> list[list[Frame]]:
        """By product, the frames with the names that OUTPUT gives."""
        if not self._frames:
            names = [self._options.output]
            if len(spec.products) > 1:
                names = [name.strip() for name in self._options.output.split(",")]
            options = self._options
            self._frames = [plan(self._stage, n, options.frames, options.default_time) for n in names]
        if len(self._frames) != len(spec.products):
            raise UsageError(
                f"'{self._options.output}' does not name the {len(spec.products)} products of {spec.path}",
                "OUTPUT",
                f"Give a folder or {PRODUCT_NAMES} for their own names, as many files with commas, or "
                "--renderSettingsPrimPath none",
            )
        return self._frames


def _file(product: Product, path: str, space: WorkingSpace, reports: Reports) -> OutputFile:
    """The file of a product. Formats without room for its variables hold the first that is a picture."""
    selection = select(product, reports)
    if Path(path).suffix.lower() == ".png" and selection is not None:
        picture = selection.picture()
        if picture is None:
            raise SettingError(
                f"none of its variables is a picture, as {path} needs one", f"{product.path}.orderedVars"
            )
        if len(selection.channels) > 1:
            reports.note(
                "variables in PNG",
                f"{path} has room for colour and alpha of {picture.channels[0].var} only",
                product.path,
            )
        selection = picture
    return OutputFile(path, product.path, selection, space)


def _renders(
    options: RecordOptions,
    spec: RenderSpec,
    named: Sequence[tuple[Product, OutputFile]],
    source: Mapping[str, str],
) -> tuple[Render, ...]:
    """The renders that give the files; those that agree in everything are one."""
    flags = sync_options(options)
    files = [file for _, file in named]
    # All the same, so that one translation serves them all.
    aovs = [a for file in files if file.selection is not None for a in file.selection.aovs]
    primvars = {a.primvar: a.components for a in sorted(aovs, key=lambda a: a.components) if a.primvar}
    common = {
        "purposes": flags["purposes"] if options.purposes is not None else spec.purposes,
        "material_purposes": spec.material_purposes,
        "aov_primvars": tuple(sorted(primvars.items())),
    }
    found: list[Render] = []
    for product, file in named:
        render = _render(options, spec, product, {**flags, **common}, source)
        for i, other in enumerate(found):
            if other.is_rendered_with(render):
                found[i] = replace(other, files=(*other.files, file))
                break
        else:
            found.append(replace(render, files=(file,)))
    return tuple(found)


def _render(
    options: RecordOptions,
    spec: RenderSpec,
    product: Product,
    sync: Mapping[str, Any],
    source: Mapping[str, str],
) -> Render:
    path = product.path or spec.path
    if product.camera_fault is not None and not options.camera:
        raise product.camera_fault
    settings = settled_settings(options, product.encore, path)
    width, height = _size(product.resolution, options.settings)
    settings |= {"width": width, "height": height}
    shutter = sync["shutter"]
    own = {
        "camera": options.camera or product.camera,
        "shutter": replace(shutter, motion_blur=shutter.motion_blur and product.motion_blur),
        "depth_of_field": sync["depth_of_field"] and product.depth_of_field,
    }
    window = data_window(product.window_ndc, width, height)
    if not (window[0] < window[2] and window[1] < window[3]):
        raise SettingError(
            f"{product.window_ndc} has no pixel's centre in it",
            f"{path}.dataWindowNDC",
            f"Make it larger: the image is {width} x {height}",
        )
    if max(window[2] - window[0], window[3] - window[1], *map(abs, window)) > LARGEST_SIDE:
        raise SettingError(
            f"{product.window_ndc} is out of range", f"{path}.dataWindowNDC", f"At most {LARGEST_SIDE} pixels"
        )
    return Render(
        {**sync, **own},
        FilmOptions(width, height, product.pixel_aspect_ratio, product.conform_policy),
        settings,
        None if window == (0, 0, width, height) else window,
        source=source,
    )


def _size(resolution: tuple[int, int], flags: Mapping[str, Any]) -> tuple[int, int]:
    """The resolution, or what flags say; of one that they do not, what keeps its shape."""
    width, height = flags.get("width"), flags.get("height")
    if width is not None and height is None:
        height = max(1, round(resolution[1] * width / resolution[0]))
    elif height is not None and width is None:
        width = max(1, round(resolution[0] * height / resolution[1]))
    return width or resolution[0], height or resolution[1]
