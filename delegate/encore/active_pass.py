"""UsdRender's RenderPass: which settings it renders, and what of the stage takes part.

What a pass prunes is deactivated, and what it hides becomes invisible, in an anonymous layer over the session
layer: nothing of it reaches a file, and everything else is composed as ever.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdRender

from encore.errors import SettingError, StageError
from encore.render_settings import paths_of, targets_of
from encore.report import Reports

# passType of passes that are rendered from RenderSettings, and not by another program.
USD_RENDER = "usdRender"
_LAYER = "encoreRenderPass.usda"
_PROXIES = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


@dataclass(frozen=True)
class RenderPassInfo:
    """A pass. settings: the path of its RenderSettings."""

    path: str
    settings: str


def read_pass(stage: Usd.Stage, path: str, reports: Reports) -> RenderPassInfo:
    """The RenderPass of that path. Raises StageError where there is none, SettingError for a useless one."""
    valid = Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsAbsolutePath()
    prim = stage.GetPrimAtPath(path) if valid else None
    if not (prim and prim.IsActive() and prim.IsA(UsdRender.Pass)):
        known = paths_of(stage, UsdRender.Pass)
        raise StageError(
            "is no RenderPass prim", path, f"Choose one of: {known}" if known else "The stage has none"
        )
    schema = UsdRender.Pass(prim)
    kind = schema.GetPassTypeAttr().Get() or ""
    if kind not in ("", USD_RENDER):
        raise SettingError(
            f"passes of type '{kind}' are not rendered", f"{path}.passType", f"Write {USD_RENDER}"
        )
    file = schema.GetFileNameAttr().Get()
    if file and file.path:
        raise SettingError(
            f"its source is in another file ({file.path})", f"{path}.fileName", "Render that file instead"
        )
    targets = targets_of(schema.GetRenderSourceRel())
    source = stage.GetPrimAtPath(targets[0]) if targets else None
    if not (source and source.IsA(UsdRender.Settings)):
        found = f"{targets[0]} is no RenderSettings prim" if targets else "it has no source"
        raise SettingError(found, f"{path}.renderSource", "Name a RenderSettings prim")
    if len(targets) > 1:
        reports.note("several sources", f"of its sources, {targets[0]} is rendered", path)
    if targets_of(schema.GetInputPassesRel()):
        inputs = ", ".join(map(str, targets_of(schema.GetInputPassesRel())))
        reports.note("inputPasses", f"needs {inputs}, which must have been rendered before", path)
    if schema.GetCommandAttr().Get():
        reports.note("command", "its command is for a render farm, and is not run", path)
    return RenderPassInfo(path, str(targets[0]))


def activate_pass(stage: Usd.Stage, path: str, reports: Reports) -> Sdf.Layer | None:
    """Makes the stage as the pass wants it: prunes and hides. The layer that does it; None: all takes part.

    path: of a RenderPass. The layer is the strongest of the stage's, until the next pass is activated.
    """
    sublayers = stage.GetSessionLayer().subLayerPaths
    for name in [n for n in sublayers if n.startswith("anon:") and n.endswith(f":{_LAYER}")]:
        sublayers.remove(name)
    prim = stage.GetPrimAtPath(path)
    _report_unsupported(prim, reports)
    prune = Usd.CollectionAPI(prim, "prune")
    visible = Usd.CollectionAPI(prim, "renderVisibility")
    if not (_says_something(prune, roots=False) or _says_something(visible, roots=True)):
        return None
    before = {p.GetPath(): _visibility(p) for p in _renderable(stage)}
    layer = Sdf.Layer.CreateAnonymous(_LAYER)
    stage.GetSessionLayer().subLayerPaths.insert(0, layer.identifier)
    if _says_something(prune, roots=False):
        _prune(stage, prune, layer)
    if _says_something(visible, roots=True):
        _hide(stage, visible, layer, before)
    return layer


def _prune(stage: Usd.Stage, prune: Usd.CollectionAPI, layer: Sdf.Layer) -> None:
    """Deactivates what is pruned, and nothing that only refers to it."""
    query = prune.ComputeMembershipQuery()
    kept, pruned = [], []
    walk = iter(Usd.PrimRange(stage.GetPseudoRoot(), _PROXIES))
    for prim in walk:
        if not prim.IsPseudoRoot() and _includes(query, prim):
            walk.PruneChildren()
            pruned.append(prim.GetPath())
        else:
            kept.append(prim.GetPath())
    _say(stage, layer, pruned, lambda spec: setattr(spec, "active", False))
    lost = [path for path in kept if (prim := stage.GetPrimAtPath(path)) and not prim.IsActive()]
    _say(stage, layer, lost, lambda spec: setattr(spec, "active", True))


def _hide(
    stage: Usd.Stage, visible: Usd.CollectionAPI, layer: Sdf.Layer, before: dict[Sdf.Path, dict[Any, str]]
) -> None:
    """Makes invisible what is not in the collection, and nothing that only refers to it.

    before: what visibility was.
    """
    query = visible.ComputeMembershipQuery()
    found = [prim.GetPath() for prim in _renderable(stage) if not _includes(query, prim)]
    _say(stage, layer, found, lambda spec: _set_visibility(spec, {None: UsdGeom.Tokens.invisible}))
    lost = [
        prim.GetPath()
        for prim in _renderable(stage)
        if _includes(query, prim) and _visibility(prim) != before.get(prim.GetPath(), _visibility(prim))
    ]
    _say(stage, layer, lost, lambda spec: _set_visibility(spec, before[spec.path]))


def _say(
    stage: Usd.Stage, layer: Sdf.Layer, paths: list[Sdf.Path], what: Callable[[Sdf.PrimSpec], None]
) -> None:
    """Authors something on prims, inside of instances too: those are no instances any more."""
    while opened := {
        _instance_path(prim) for p in paths if (prim := stage.GetPrimAtPath(p)).IsInstanceProxy()
    }:
        with Sdf.ChangeBlock():
            for path in opened:
                Sdf.CreatePrimInLayer(layer, path).instanceable = False
    with Sdf.ChangeBlock():
        for path in paths:
            what(Sdf.CreatePrimInLayer(layer, path))


def _visibility(prim: Usd.Prim) -> dict[Any, str]:
    """What the prim says of its own visibility, by time; None: where there are no times."""
    attribute = UsdGeom.Imageable(prim).GetVisibilityAttr()
    times = attribute.GetTimeSamples()
    return {time: str(attribute.Get(time)) for time in times} if times else {None: str(attribute.Get())}


def _set_visibility(spec: Sdf.PrimSpec, values: dict[Any, str]) -> None:
    name = UsdGeom.Tokens.visibility
    attribute = spec.attributes.get(name) or Sdf.AttributeSpec(spec, name, Sdf.ValueTypeNames.Token)
    for time, value in values.items():
        if time is None:
            attribute.default = value
        else:
            spec.layer.SetTimeSample(attribute.path, time, value)


def _renderable(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Geometry and lights, each of which is hidden by itself; PointInstancers with what they place."""
    walk = iter(Usd.PrimRange(stage.GetPseudoRoot(), _PROXIES))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
            yield prim
        elif prim.IsA(UsdGeom.Gprim) or prim.HasAPI(UsdLux.LightAPI):
            yield prim


def _includes(query: Usd.UsdCollectionMembershipQuery, prim: Usd.Prim) -> bool:
    found = query.IsPathIncluded(prim.GetPath())
    return bool(found[0] if isinstance(found, tuple) else found)


def _instance_path(proxy: Usd.Prim) -> Sdf.Path:
    """Of the instance on the stage that a prim is shown by."""
    while proxy.IsInstanceProxy():
        proxy = proxy.GetParent()
    return proxy.GetPath()


def _says_something(collection: Usd.CollectionAPI, *, roots: bool) -> bool:
    """Whether a collection differs from what the schema of passes gives it. roots: of its includeRoot.

    One that this version of USD does not know for passes, and that is not applied, says nothing.
    """
    expression, include_root = collection.GetMembershipExpressionAttr(), collection.GetIncludeRootAttr()
    return bool(
        targets_of(collection.GetIncludesRel())
        or targets_of(collection.GetExcludesRel())
        or (expression and str(expression.Get() or ""))
        or (include_root and bool(include_root.Get()) != roots)
    )


def _report_unsupported(prim: Usd.Prim, reports: Reports) -> None:
    for name, roots, effect in (
        ("cameraVisibility", True, "the camera sees everything"),
        ("matte", False, "nothing is a matte"),
    ):
        if _says_something(Usd.CollectionAPI(prim, name), roots=roots):
            reports.add(
                f"unsupported {name}", f"its collection {name} is not supported yet: {effect}", prim.GetPath()
            )
