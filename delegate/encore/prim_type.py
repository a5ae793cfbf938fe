"""What prims of a type are to Hydra: rprims, instancers, lights, or what holds them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pxr import Usd, UsdGeom, UsdLux, UsdShade, UsdSkel, Vt

from encore.adapters import light
from encore.adapters.unsupported import may_be_unsupported
from encore.groups import Kind, PrimType
from encore.readers import reader_of


def prim_type(prim: Usd.Prim, name: str) -> PrimType:
    """name: of the prim's type."""
    definition = prim.GetPrimDefinition()
    asks = any(definition.GetAttributeFallbackValue(n) not in (None, v) for n, v in _FALLBACKS.items())
    return PrimType(
        name,
        _kind_of(prim, name),
        prim.IsA(UsdGeom.Imageable),
        prim.HasAPI(UsdShade.MaterialBindingAPI),
        prim.HasAPI(UsdLux.LightAPI),
        prim.HasAPI(UsdGeom.ModelAPI),
        asks,
        may_be_unsupported(prim.GetAppliedSchemas()),
    )


# What UsdGeomImageable and UsdGeomXformable have where nothing is authored.
_FALLBACKS: Mapping[str, Any] = {
    "visibility": UsdGeom.Tokens.inherited,
    "purpose": UsdGeom.Tokens.default_,
    "xformOpOrder": Vt.TokenArray(),
}


_LIGHT_BASES = (UsdLux.BoundableLightBase, UsdLux.NonboundableLightBase, UsdLux.LightFilter)
_OTHER_LIGHTS = frozenset({"PluginLight"})


def _kind_of(prim: Usd.Prim, name: str) -> Kind:
    if reader_of(prim, name) is not None:
        return Kind.RPRIM
    if prim.IsA(UsdGeom.PointInstancer):
        return Kind.INSTANCER
    if name in light.TYPES:
        return Kind.LIGHT
    if name == "GeometryLight":
        return Kind.GEOMETRY_LIGHT
    if name in _OTHER_LIGHTS or any(prim.IsA(base) for base in _LIGHT_BASES):
        return Kind.UNSUPPORTED_LIGHT
    if prim.IsA(UsdGeom.Subset) or prim.IsA(UsdShade.NodeGraph) or prim.IsA(UsdShade.Shader):
        return Kind.SKIP
    if prim.IsA(UsdGeom.Boundable) and not (prim.IsA(UsdSkel.Root) or prim.IsA(UsdSkel.Skeleton)):
        return Kind.UNSUPPORTED
    return Kind.CONTAINER
