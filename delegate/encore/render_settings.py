"""UsdRender's RenderSettings and RenderProducts: what a stage says of the images to make of it.

UsdRenderComputeSpec(), which Python does not have, is the model: a product has the attributes of its
settings, but for those that it authors itself. Fallbacks of the schema count as said, too.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from pxr import Sdf, Usd, UsdGeom, UsdRender

from encore.errors import SettingError, StageError, UsageError
from encore.report import Reports
from encore.settings import STAGE_SETTINGS, Setting

# What --renderSettingsPrimPath takes for: as if the stage had none.
NO_SETTINGS = "none"
POLICIES = (
    "expandAperture",
    "cropAperture",
    "adjustApertureWidth",
    "adjustApertureHeight",
    "adjustPixelAspectRatio",
)
LARGEST_SIDE = 65536  # pixels
_LARGEST_PIXEL_ASPECT = 1000.0
# Of an aov in Houdini's RenderVars: the name of its channels.
_CHANNEL_NAMES = ("driver:parameters:aov:name", "driver:parameters:aov:channel_prefix")


@dataclass(frozen=True)
class RenderVar:
    """A RenderVar prim. data_type: empty where it is not authored. channel: its name for channels, if any."""

    path: str
    data_type: str
    source_type: str
    source_name: str
    channel: str = ""

    @property
    def name(self) -> str:
        return self.path.rpartition("/")[2]


@dataclass(frozen=True)
class Product:
    """An image, with what its settings say and it does not say itself.

    path: empty where the settings have no products and ask for an image of their own. window_ndc: xmin, ymin,
    xmax, ymax of the conformed aperture, y up. encore: by key of encore.settings, as authored. camera_fault:
    what to raise where its camera is used, and not another one.
    """

    path: str
    camera: str = ""
    camera_fault: SettingError | None = None
    resolution: tuple[int, int] = (2048, 1080)
    pixel_aspect_ratio: float = 1.0
    conform_policy: str = "expandAperture"
    window_ndc: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)
    motion_blur: bool = True
    depth_of_field: bool = True
    encore: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    vars: tuple[RenderVar, ...] = ()


@dataclass(frozen=True)
class RenderSpec:
    """What a RenderSettings prim says at a time: its products, and what holds for all of them."""

    path: str
    products: tuple[Product, ...]
    purposes: tuple[str, ...]
    material_purposes: tuple[str, ...]
    color_space: str = ""


def find_settings(stage: Usd.Stage, path: str, reports: Reports) -> UsdRender.Settings | None:
    """The RenderSettings prim of that path; without one, that which the stage names; None: there is none.

    Raises StageError for a given path that has none; what the stage names in vain is reported.
    """
    if path == NO_SETTINGS:
        return None
    named = path or str(stage.GetMetadata("renderSettingsPrimPath") or "")
    if not named:
        return None
    valid = Sdf.Path.IsValidPathString(named) and Sdf.Path(named).IsAbsolutePath()
    prim = stage.GetPrimAtPath(named) if valid else None
    fault = _fault(prim, UsdRender.Settings, "RenderSettings prim")
    if not fault:
        return UsdRender.Settings(prim)
    if path:
        known = paths_of(stage, UsdRender.Settings)
        raise StageError(fault, path, f"Choose one of: {known}" if known else "The stage has none")
    reports.error(
        "no render settings",
        f"{fault}, but the stage's renderSettingsPrimPath names it ({named}): flags decide",
        named,
    )
    return None


def read_settings(settings: UsdRender.Settings, time: Usd.TimeCode, reports: Reports) -> RenderSpec:
    """What the settings and their products say. Raises SettingError for values that cannot be used."""
    prim = settings.GetPrim()
    reader = _Reader(time, reports)
    base = reader.base(prim, Product(""), own=False)
    products = [p for p in map(reader.product_prim(prim), targets_of(settings.GetProductsRel())) if p]
    found = [replace(reader.base(p, base, own=True), path=str(p.GetPath())) for p in products]
    found = [reader.output(p, product) for p, product in zip(products, found, strict=True)]
    if not found and targets_of(settings.GetProductsRel()):
        raise SettingError(
            "none of its products can be rendered",
            f"{prim.GetPath()}.products",
            last_report(reports),
        )
    return RenderSpec(
        str(prim.GetPath()),
        tuple(found) or (base,),
        reader.purposes(settings),
        reader.material_purposes(settings),
        str(reader.value(settings.GetRenderingColorSpaceAttr()) or ""),
    )


def data_window(
    window_ndc: tuple[float, float, float, float], width: int, height: int
) -> tuple[int, int, int, int]:
    """The pixels whose centres are in the window: (x0, y0, x1, y1), y down, x1 and y1 excluded.

    Centres on the left and lower edges are in, those on the others are not (UsdRender's rasterization rule).
    """
    x_min, y_min, x_max, y_max = window_ndc
    # Products of a float and of a whole number up to 65536 are exact in double precision.
    left, right = (math.ceil(x * width - 0.5) for x in (x_min, x_max))
    bottom, top = (math.ceil(y * height - 0.5) for y in (y_min, y_max))
    return left, height - top, right, height - bottom


class _Role(NamedTuple):
    """What a relationship wants of its targets. name: in messages. report: kind of the report of others."""

    schema: Any
    type_name: str
    name: str
    report: str


_PRODUCT = _Role(UsdRender.Product, "RenderProduct", "product", "bad product")
_VARIABLE = _Role(UsdRender.Var, "RenderVar", "variable", "bad render var")


class _Reader:
    """Reads prims at a time. Values that have no meaning raise SettingError."""

    def __init__(self, time: Usd.TimeCode, reports: Reports) -> None:
        self._time = time
        self._reports = reports

    def value(self, attribute: Usd.Attribute) -> Any:
        return attribute.Get(self._time) if attribute else None

    def is_authored(self, attribute: Usd.Attribute) -> bool:
        """Whether it says something at this time: time samples say nothing at the default time."""
        return bool(attribute) and attribute.GetResolveInfo(self._time).HasAuthoredValue()

    def product_prim(self, settings: Usd.Prim) -> Any:
        """Target of `products` → its prim; None, and a report, for what is not rendered."""

        def prim_of(target: Sdf.Path) -> Usd.Prim | None:
            prim = self._named(settings, target, _PRODUCT)
            if prim is None:
                return None
            kind = self.value(UsdRender.Product(prim).GetProductTypeAttr())
            if kind != UsdRender.Tokens.raster:
                self._reports.add(
                    f"unsupported productType {kind}",
                    f"productType {kind} is not supported yet: it is left out",
                    prim.GetPath(),
                )
                return None
            return prim

        return prim_of

    def _named(self, owner: Usd.Prim, target: Sdf.Path, role: _Role) -> Usd.Prim | None:
        """The prim that a relationship of `owner` names; None, and a report, where it is none of the role."""
        prim = owner.GetStage().GetPrimAtPath(target)
        fault = _fault(prim, role.schema, role.type_name)
        if fault:
            found = f"{fault}, but {owner.GetPath()} names it as a {role.name}: left out"
            self._reports.error(role.report, found, target)
            return None
        return prim

    def base(self, prim: Usd.Prim, base: Product, *, own: bool) -> Product:
        """`base`, changed by the prim's RenderSettingsBase attributes. own: only by those it authors."""
        schema = UsdRender.SettingsBase(prim)
        found: dict[str, Any] = {}

        def read(key: str, attribute: Usd.Attribute, convert: Any) -> None:
            value = self.value(attribute)
            if value is not None and (not own or self.is_authored(attribute)):
                found[key] = convert(attribute, value)

        read("resolution", schema.GetResolutionAttr(), _resolution)
        read("pixel_aspect_ratio", schema.GetPixelAspectRatioAttr(), _pixel_aspect_ratio)
        read("conform_policy", schema.GetAspectRatioConformPolicyAttr(), _policy)
        read("window_ndc", schema.GetDataWindowNDCAttr(), _window_ndc)
        read("depth_of_field", schema.GetDisableDepthOfFieldAttr(), _is_off)
        read("motion_blur", schema.GetDisableMotionBlurAttr(), _is_off)
        instantaneous = schema.GetInstantaneousShutterAttr()
        if self.is_authored(instantaneous) and self.value(instantaneous):
            found["motion_blur"] = False
        found |= self._camera(schema)
        found["encore"] = {**base.encore, **self._encore(prim)}
        return replace(base, **found)

    def _camera(self, schema: UsdRender.SettingsBase) -> dict[str, Any]:
        """`camera` and `camera_fault` of a product, if a camera is named."""
        targets = targets_of(schema.GetCameraRel())
        if not targets:
            return {}
        camera, path, stage = targets[0], schema.GetPrim().GetPath(), schema.GetPrim().GetStage()
        if len(targets) > 1:
            self._reports.note("several cameras", f"of its cameras, {camera} is used", path)
        fault = _fault(stage.GetPrimAtPath(camera), UsdGeom.Camera, "camera")
        masked = not stage.GetPopulationMask().Includes(camera.GetPrimPath())
        remedy = "Add it to --mask" if masked else "Name a Camera prim"
        error = SettingError(f"{camera} {fault}", f"{path}.camera", remedy) if fault else None
        return {"camera": str(camera), "camera_fault": error}

    def output(self, prim: Usd.Prim, product: Product) -> Product:
        """The product with its name and variables."""
        schema = UsdRender.Product(prim)
        variables = []
        for target in targets_of(schema.GetOrderedVarsRel()):
            var = self._named(prim, target, _VARIABLE)
            if var is not None:
                variables.append(self._var(UsdRender.Var(var)))
        if not variables and targets_of(schema.GetOrderedVarsRel()):
            raise SettingError(
                "none of its variables exists",
                f"{prim.GetPath()}.orderedVars",
                last_report(self._reports),
            )
        name = str(self.value(schema.GetProductNameAttr()) or "")
        return replace(product, name=name, vars=tuple(variables))

    def _var(self, var: UsdRender.Var) -> RenderVar:
        prim = var.GetPrim()
        authored = self.is_authored(var.GetDataTypeAttr())
        names = (self.value(prim.GetAttribute(name)) for name in _CHANNEL_NAMES)
        return RenderVar(
            str(prim.GetPath()),
            str(self.value(var.GetDataTypeAttr())) if authored else "",
            str(self.value(var.GetSourceTypeAttr()) or "raw"),
            str(self.value(var.GetSourceNameAttr()) or "") or prim.GetName(),
            next((str(name) for name in names if name), ""),
        )

    def purposes(self, settings: UsdRender.Settings) -> tuple[str, ...]:
        known = UsdGeom.Imageable.GetOrderedPurposeTokens()
        return self._tokens(settings.GetIncludedPurposesAttr(), {name: name for name in known})

    def material_purposes(self, settings: UsdRender.Settings) -> tuple[str, ...]:
        # Houdini writes allPurpose for what the schema calls "".
        known = {"full": "full", "preview": "preview", "": "", "allPurpose": ""}
        return self._tokens(settings.GetMaterialBindingPurposesAttr(), known)

    def _tokens(self, attribute: Usd.Attribute, known: Mapping[str, str]) -> tuple[str, ...]:
        """The tokens of an attribute as `known` calls them, each once; others are reported."""
        found: dict[str, None] = {}
        for token in _token_list(attribute, self.value(attribute)):
            if token in known:
                found[known[token]] = None
            else:
                there_are = ", ".join(repr(name) for name in known)
                self._reports.error(
                    f"bad {attribute.GetName()}",
                    f"{attribute.GetName()} names '{token}', which is left out: there are {there_are}",
                    attribute.GetPrim().GetPath(),
                )
        return tuple(found)

    def _encore(self, prim: Usd.Prim) -> dict[str, Any]:
        """Encore's own settings that the prim authors, by key."""
        found = {}
        for attribute in prim.GetAuthoredAttributes():
            name = attribute.GetName()
            if not name.startswith("encore:") or not attribute.HasAuthoredValue():
                continue
            value = self.value(attribute)
            setting = STAGE_SETTINGS.get(name)
            if setting is None:
                close = difflib.get_close_matches(name, STAGE_SETTINGS, 1)
                hint = f", did you mean {close[0]}?" if close else ""
                self._reports.error(
                    f"unknown setting {name}", f"{name} is no setting of Encore{hint}", prim.GetPath()
                )
                continue
            if value is not None:  # nor at the default time, where there are time samples only
                found[setting.key] = read_setting(setting, attribute, value)
        return found


def read_setting(setting: Setting, attribute: Usd.Attribute, value: Any) -> Any:
    """The value of one of Encore's settings. Raises SettingError that names the attribute."""
    accepted = {
        "bool": (bool, int),
        "int": (int,),
        "size": (int,),
        "float": (int, float),
        "choice": (str,),
    }[setting.kind]
    if not isinstance(value, accepted) or (setting.kind != "bool" and isinstance(value, bool)):
        raise _bad(attribute, value, f"It must be of type {setting.usd_type_name}: {setting.range_text}")
    number: Any = bool(value) if setting.kind == "bool" else value
    try:
        setting.check(number)
    except (SettingError, UsageError):
        raise _bad(attribute, value, f"It must be {setting.range_text.replace('`', '')}") from None
    return number


def _bad(attribute: Usd.Attribute, value: Any, remedy: str) -> SettingError:
    return SettingError(f"{value!s} is out of range", str(attribute.GetPath()), remedy)


def _resolution(attribute: Usd.Attribute, value: Any) -> tuple[int, int]:
    numbers = _items(value) or []
    if len(numbers) != 2 or not all(isinstance(n, (int, float)) and float(n).is_integer() for n in numbers):
        raise _bad(attribute, value, "It must be two whole numbers")
    width, height = map(int, numbers)
    if not all(1 <= n <= LARGEST_SIDE for n in (width, height)):
        raise _bad(attribute, value, f"Both numbers must be from 1 to {LARGEST_SIDE}")
    return width, height


def _pixel_aspect_ratio(attribute: Usd.Attribute, value: Any) -> float:
    if not (isinstance(value, float) and 1 / _LARGEST_PIXEL_ASPECT <= value <= _LARGEST_PIXEL_ASPECT):
        raise _bad(
            attribute, value, f"It must be from {1 / _LARGEST_PIXEL_ASPECT:g} to {_LARGEST_PIXEL_ASPECT:g}"
        )
    return value


def _policy(attribute: Usd.Attribute, value: Any) -> str:
    if value not in POLICIES:
        raise _bad(attribute, f"'{value}'", f"Choose one of: {', '.join(POLICIES)}")
    return str(value)


def _window_ndc(attribute: Usd.Attribute, value: Any) -> tuple[float, float, float, float]:
    try:
        x0, y0, x1, y1 = (float(n) for n in value)
    except (TypeError, ValueError):
        raise _bad(attribute, value, "It must be four numbers: xmin, ymin, xmax, ymax") from None
    if not (all(map(math.isfinite, (x0, y0, x1, y1))) and x0 < x1 and y0 < y1):
        raise _bad(attribute, value, "It must be xmin, ymin, xmax, ymax, with xmin < xmax and ymin < ymax")
    return x0, y0, x1, y1


def _items(value: Any) -> list[Any] | None:
    """The items of an array or a vector; None: it is neither, as strings."""
    try:
        return None if isinstance(value, str) else list(value)
    except TypeError:
        return None


def _token_list(attribute: Usd.Attribute, value: Any) -> list[str]:
    tokens = [] if value is None else _items(value)
    if tokens is None or not all(isinstance(token, str) for token in tokens):
        raise _bad(attribute, value, "It must be a list of tokens")
    return tokens


def _is_off(attribute: Usd.Attribute, value: Any) -> bool:
    """Whether an attribute that disables something does not."""
    if not isinstance(value, (bool, int)):
        raise _bad(attribute, value, "It must be true or false")
    return not value


def _fault(prim: Usd.Prim | None, schema: Any, name: str) -> str:
    """What keeps a prim from being used as one of a schema, called name; empty: nothing."""
    if not (prim and prim.IsA(schema)):
        return f"is no {name}"
    return "" if prim.IsActive() else "is deactivated"


def last_report(reports: Reports) -> str:
    """`/path: message` of what was reported last, for errors that come of it: only those are printed."""
    ((_, message, path, _),) = reports.since(reports.mark - 1)
    return f"{path}: {message}"


def targets_of(relationship: Usd.Relationship) -> list[Sdf.Path]:
    return list(relationship.GetForwardedTargets()) if relationship else []


def paths_of(stage: Usd.Stage, schema: Any) -> str:
    """Paths of the stage's prims of a schema, for messages."""
    found: Iterable[Usd.Prim] = (prim for prim in stage.Traverse() if prim.IsA(schema))
    return ", ".join(str(prim.GetPath()) for prim in list(found)[:20])
