"""The codeless USD schema of Encore's own attributes (schemas/schema.usda), made known to USD."""

from __future__ import annotations

from pathlib import Path

from pxr import Plug

API_SCHEMA = "EncorePrimvarsAPI"
MATERIAL_API_SCHEMA = "EncoreMaterialAPI"
LIGHT_API_SCHEMA, CAMERA_API_SCHEMA = "EncoreLightAPI", "EncoreCameraAPI"
# Its attributes are encore.settings.STAGE_SETTINGS.
RENDER_SETTINGS_API_SCHEMA = "EncoreRenderSettingsAPI"
TARGET_EDGE_LENGTH = "primvars:encore:targetEdgeLength"
SHADING_RATE = "primvars:encore:shadingRate"
LAYER_SHADING_RATES = tuple(f"{SHADING_RATE}:{layer}" for layer in ("direct", "reflection", "refraction"))
THIN_WALLED = "primvars:encore:thinWalled"
DIELECTRIC_PRIORITY = "inputs:encore:dielectricPriority"
LIGHT_SAMPLES = "encore:samples"
APERTURE_BLADES, APERTURE_ROTATION = "encore:apertureBlades", "encore:apertureRotation"


def folder() -> Path:
    """The folder of plugInfo.json: inside the installed package, or in the source tree."""
    package = Path(__file__).resolve().parent
    installed = package / "schemas"
    return installed if installed.is_dir() else package.parent.parent / "schemas"


def register() -> bool:
    """Registers the schema with USD; True if USD knows its plugin afterwards.

    Only effective before USD's schema registry is first used (by opening a stage, for one). Until then USD
    does not read it: no attribute is rendered differently, but ApplyAPI and validation do not know the name.
    """
    registry = Plug.Registry()
    if registry.GetPluginWithName("encoreSchema") is None:
        registry.RegisterPlugins(str(folder()))
    return registry.GetPluginWithName("encoreSchema") is not None
