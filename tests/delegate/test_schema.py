"""The codeless schema, in processes of its own because USD reads schemas once."""

import json
import os
import subprocess
import sys
from pathlib import Path

import encore
import pytest
from encore import schema
from encore.settings import SETTINGS, STAGE_SETTINGS
from pxr import Sdf

PACKAGE_PARENT = str(Path(encore.__file__).parents[1])
NUMBERS = {schema.TARGET_EDGE_LENGTH, schema.SHADING_RATE, *schema.LAYER_SHADING_RATES}
NAMES = {*NUMBERS, schema.THIN_WALLED}
SOURCE = Path(__file__).parents[2] / "schemas" / "schema.usda"


def run(code: str, **environment: str) -> str:
    """Standard output of a fresh Python that runs the code."""
    variables = {**os.environ, "PYTHONPATH": PACKAGE_PARENT, **environment}
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


STAGE = """
from pxr import Usd, UsdGeom
stage = Usd.Stage.CreateInMemory()
UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
UsdGeom.SetStageMetersPerUnit(stage, 1)
world = UsdGeom.Xform.Define(stage, "/World")
stage.SetDefaultPrim(world.GetPrim())
prim = UsdGeom.Cube.Define(stage, "/World/Cube").GetPrim()
"""


def test_apply_api() -> None:
    out = run(
        "import encore" + STAGE + "assert prim.CanApplyAPI('EncorePrimvarsAPI')\n"
        "assert prim.ApplyAPI('EncorePrimvarsAPI')\n"
        "assert prim.HasAPI('EncorePrimvarsAPI')\n"
        "edge = prim.GetAttribute('primvars:encore:targetEdgeLength')\n"
        "assert edge.Get() == 0 and not edge.HasAuthoredValue()\n"
        "edge.Set(0.25)\n"
        "print(stage.GetRootLayer().ExportToString())"
    )
    assert 'prepend apiSchemas = ["EncorePrimvarsAPI"]' in out
    assert "float primvars:encore:targetEdgeLength = 0.25" in out


def test_registry_knows_properties_fallbacks_and_documentation() -> None:
    found = json.loads(
        run(
            "import encore, json\nfrom pxr import Usd\n"
            "d = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition('EncorePrimvarsAPI')\n"
            "names = d.GetPropertyNames()\n"
            "attributes = [d.GetAttributeDefinition(n) for n in names]\n"
            "print(json.dumps({n: [str(a.GetTypeName()), a.GetFallbackValue(), d.GetPropertyDocumentation(n)]"
            " for n, a in zip(names, attributes)}))"
        )
    )
    assert set(found) == NAMES
    assert all(found[name][:2] == ["float", 0] for name in NUMBERS)
    assert found[schema.THIN_WALLED][:2] == ["bool", None], "not authored means: as the mesh is closed"
    assert "window pane" in found[schema.THIN_WALLED][2]
    assert "world units" in found[schema.TARGET_EDGE_LENGTH][2]
    assert "per pixel" in found[schema.SHADING_RATE][2]
    for name in schema.LAYER_SHADING_RATES:
        assert f"{name.rpartition(':')[2]} layer" in found[name][2]


def test_material_api() -> None:
    out = run(
        "import encore" + STAGE + "from pxr import UsdShade\n"
        "assert not prim.CanApplyAPI('EncoreMaterialAPI'), 'only to materials'\n"
        "material = UsdShade.Material.Define(stage, '/World/Glass').GetPrim()\n"
        "assert material.ApplyAPI('EncoreMaterialAPI')\n"
        "attribute = material.GetAttribute('inputs:encore:dielectricPriority')\n"
        "assert attribute.Get() == 0 and not attribute.HasAuthoredValue()\n"
        "attribute.Set(2)\n"
        "assert UsdShade.Material(material).GetInput('encore:dielectricPriority').Get() == 2\n"
        "d = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition('EncoreMaterialAPI')\n"
        "print(d.GetPropertyNames(), d.GetPropertyDocumentation('inputs:encore:dielectricPriority'))"
    )
    assert f"['{schema.DIELECTRIC_PRIORITY}']" in out and "overlap" in out


def test_light_and_camera_apis() -> None:
    out = run(
        "import encore" + STAGE + "from pxr import UsdLux\n"
        "assert not prim.CanApplyAPI('EncoreCameraAPI'), 'only to cameras'\n"
        "light = UsdLux.RectLight.Define(stage, '/World/Light').GetPrim()\n"
        "camera = UsdGeom.Camera.Define(stage, '/World/Camera').GetPrim()\n"
        "assert light.ApplyAPI('EncoreLightAPI') and camera.ApplyAPI('EncoreCameraAPI')\n"
        "names = ('encore:samples', 'encore:apertureBlades', 'encore:apertureRotation')\n"
        "found = [p.GetAttribute(n) for p in (light, camera) for n in names if p.HasAttribute(n)]\n"
        "print([(a.GetName(), a.Get()) for a in found])"
    )
    expected = [("encore:samples", 0), ("encore:apertureBlades", 0), ("encore:apertureRotation", 0.0)]
    assert out.strip() == str(expected)


def test_plugin_path_variable_does_the_same_without_importing_encore() -> None:
    code = STAGE + "assert prim.ApplyAPI('EncorePrimvarsAPI'); print('applied')"
    assert "applied" in run(code, PXR_PLUGINPATH_NAME=str(schema.folder()))


VALIDATE = """
import encore
from pxr import UsdValidation
registry = UsdValidation.ValidationRegistry()
def errors():
    found = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators()).Validate(stage)
    return [f"{e.GetName()}: {e.GetMessage()}" for e in found]
"""


def test_validation_is_clean_with_it_and_not_blind() -> None:
    pytest.importorskip("pxr.UsdValidation", reason="this USD has no UsdValidation")
    out = run(
        VALIDATE + STAGE + "prim.ApplyAPI('EncorePrimvarsAPI')\n"
        "prim.GetAttribute('primvars:encore:targetEdgeLength').Set(0.25)\n"
        "prim.GetAttribute('primvars:encore:shadingRate').Set(4)\n"
        "prim.GetAttribute('primvars:encore:shadingRate:reflection').Set(1)\n"
        "prim.GetAttribute('primvars:encore:thinWalled').Set(True)\n"
        "settings = stage.DefinePrim('/Render/Settings', 'RenderSettings')\n"
        "settings.ApplyAPI('EncoreRenderSettingsAPI')\n"
        "settings.GetAttribute('encore:samples').Set(4)\n"
        "material = stage.DefinePrim('/World/Glass', 'Material')\n"
        "material.ApplyAPI('EncoreMaterialAPI')\n"
        "material.GetAttribute('inputs:encore:dielectricPriority').Set(1)\n"
        "print(len(errors()), errors())\n"
        "from pxr import Sdf\n"
        "spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), '/World/Cube')\n"
        "spec.RemoveProperty(spec.attributes['primvars:encore:shadingRate'])\n"
        "Sdf.AttributeSpec(spec, 'primvars:encore:shadingRate', Sdf.ValueTypeNames.String)\n"
        "print('\\n'.join(errors()))"
    )
    clean, *mistyped = out.splitlines()
    assert clean == "0 []"
    assert any("primvars:encore:shadingRate" in line for line in mistyped)


def test_compliance_checker_is_clean_with_it() -> None:
    from pxr import UsdUtils

    if not hasattr(UsdUtils, "ComplianceChecker"):
        pytest.skip("this USD has no UsdUtils.ComplianceChecker")
    out = run(
        "import encore" + STAGE + "prim.ApplyAPI('EncorePrimvarsAPI')\n"
        "from pxr import UsdUtils\n"
        "checker = UsdUtils.ComplianceChecker(skipARKitRootLayerCheck=True)\n"
        "import tempfile, os\n"
        "path = os.path.join(tempfile.mkdtemp(), 'a.usda')\n"
        "stage.GetRootLayer().Export(path)\n"
        "checker.CheckCompliance(path)\n"
        "print(checker.GetErrors(), checker.GetFailedChecks())"
    )
    assert out.strip() == "[] []"


def test_generated_schema_is_made_of_the_source() -> None:
    source_layer = Sdf.Layer.OpenAsAnonymous(str(SOURCE))
    generated_layer = Sdf.Layer.OpenAsAnonymous(str(schema.folder() / "generatedSchema.usda"))

    def facts(prim: Sdf.PrimSpec) -> dict[str, tuple[object, ...]]:
        return {
            p.name: (p.typeName, p.default, p.variability, p.displayName, p.displayGroup, p.allowedTokens)
            for p in prim.attributes
        }

    for api, names in (
        (schema.API_SCHEMA, NAMES),
        (schema.MATERIAL_API_SCHEMA, {schema.DIELECTRIC_PRIORITY}),
        (schema.LIGHT_API_SCHEMA, {schema.LIGHT_SAMPLES}),
        (schema.CAMERA_API_SCHEMA, {schema.APERTURE_BLADES, schema.APERTURE_ROTATION}),
        (schema.RENDER_SETTINGS_API_SCHEMA, set(STAGE_SETTINGS)),
    ):
        made = facts(generated_layer.GetPrimAtPath(f"/{api}"))
        assert facts(source_layer.GetPrimAtPath(f"/{api}")) == made
        assert set(made) == names


def test_render_settings_are_those_of_the_table() -> None:
    layer = Sdf.Layer.OpenAsAnonymous(str(SOURCE))
    attributes = layer.GetPrimAtPath(f"/{schema.RENDER_SETTINGS_API_SCHEMA}").attributes
    assert [a.name for a in attributes] == list(STAGE_SETTINGS)
    for attribute in attributes:
        setting = STAGE_SETTINGS[attribute.name]
        assert attribute.typeName == setting.usd_type_name
        assert attribute.variability == Sdf.VariabilityUniform
        if setting.kind == "float":
            assert attribute.default == pytest.approx(setting.default)
        else:
            assert attribute.default == setting.default
        assert tuple(attribute.allowedTokens or ()) == setting.choices
        text = " ".join(attribute.documentation.split())
        assert text.startswith(setting.doc.replace("`", ""))
        if setting.kind in ("int", "float", "size"):
            assert text.lower().endswith(f"{setting.range_text}.".lower())


def test_which_settings_the_stage_may_say() -> None:
    unsaid = {s.key for s in SETTINGS.values()} - {s.key for s in STAGE_SETTINGS.values()}
    assert unsaid == {"width", "height", "shader_cache", "threads"}
    assert STAGE_SETTINGS["encore:shadingRate"].key == "shading_rate"
    assert STAGE_SETTINGS["encore:energyCompensation"].key == "energy_compensation"
    assert STAGE_SETTINGS["encore:memory"].key == "memory_budget_bytes"


def test_render_settings_api() -> None:
    out = run(
        "import encore" + STAGE + "from pxr import UsdRender\n"
        "assert not prim.CanApplyAPI('EncoreRenderSettingsAPI'), 'only to settings and products'\n"
        "settings = UsdRender.Settings.Define(stage, '/Render/Settings').GetPrim()\n"
        "product = UsdRender.Product.Define(stage, '/Render/Product').GetPrim()\n"
        "assert settings.ApplyAPI('EncoreRenderSettingsAPI')\n"
        "assert product.ApplyAPI('EncoreRenderSettingsAPI')\n"
        "print(settings.GetAttribute('encore:samples').Get(), settings.GetAttribute('encore:method').Get())"
    )
    assert out.split() == ["8", "reuse"]


def test_names_are_those_that_the_translation_reads() -> None:
    from encore.adapters.camera import APERTURE_BLADES, APERTURE_ROTATION
    from encore.adapters.light import SAMPLES
    from encore.adapters.material import DIELECTRIC_PRIORITY
    from encore.adapters.primvars import SHADING_RATES, TARGET_EDGE_LENGTH, THIN_WALLED

    read = (*SHADING_RATES, TARGET_EDGE_LENGTH, THIN_WALLED)
    assert {f"primvars:{name}" for name in read} == NAMES
    assert DIELECTRIC_PRIORITY == schema.DIELECTRIC_PRIORITY
    assert SAMPLES == schema.LIGHT_SAMPLES
    assert (APERTURE_BLADES, APERTURE_ROTATION) == (schema.APERTURE_BLADES, schema.APERTURE_ROTATION)
