"""docs/coverage.md against USD's schema registry, and its claims against small stages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
import pytest
from coverage_probes import OTHERS, PROBES, Schema
from encore.dump import dump
from encore.errors import StageError
from encore.render_index import RenderIndex, SyncOptions
from pxr import Plug, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, UsdSkel, UsdVol

DOCUMENT = Path(__file__).parents[2] / "docs" / "coverage.md"
LIBRARIES = {
    "UsdGeom": UsdGeom,
    "UsdShade": UsdShade,
    "UsdLux": UsdLux,
    "UsdRender": UsdRender,
    "UsdSkel": UsdSkel,
    "UsdVol": UsdVol,
}
STATUSES = ("yes", "approximated", "no", "hint")
# Tested by their own tests (test_render_settings.py and its neighbours): they are no part of the scene.
ELSEWHERE = {"RenderSettingsBase", "RenderSettings", "RenderProduct", "RenderVar", "RenderPass"}
# One type of field says it for all: volumes are not rendered.
ABSTRACT = {"FieldAsset", "FieldBase", "VolumeFieldAsset", "VolumeFieldBase"}


class Row(NamedTuple):
    status: str
    note: str


Tables = dict[str, dict[str, dict[str, Row]]]  # library → schema → attribute, "" for the schema itself


def documented() -> Tables:
    tables: Tables = {}
    library = schema = ""
    for line in DOCUMENT.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            library = line[3:]
            tables[library] = {}
        elif match := re.fullmatch(r"\| \*\*(\w+)\*\* \| (\w+) \|(.*)\|", line):
            schema = match[1]
            assert schema not in tables[library], f"{schema} is there twice"
            tables[library][schema] = {"": Row(match[2], match[3].strip())}
        elif match := re.fullmatch(r"\| \.`([\w:]+)` \| (\w+) \|(.*)\|", line):
            assert match[1] not in tables[library][schema], f"{schema}.{match[1]} is there twice"
            tables[library][schema][match[1]] = Row(match[2], match[3].strip())
    return tables


def _schema_name(name: str, entry: dict[str, object]) -> str:
    alias = entry.get("alias")
    known = alias.get("UsdSchemaBase") if isinstance(alias, dict) else None
    return str(entry.get("schemaIdentifier") or known or name)


def _properties(type_name: str) -> set[str]:
    """Of a schema's own class and those that it inherits from, without what is built in."""
    plugin = Plug.Registry().GetPluginForType(Tf.Type.FindByName(type_name))
    if plugin is None or type_name not in plugin.metadata.get("Types", {}):
        return set()
    layer = Sdf.Layer.FindOrOpen(f"{plugin.resourcePath}/generatedSchema.usda")
    name = _schema_name(type_name, plugin.metadata["Types"][type_name])
    prim = layer.GetPrimAtPath(f"/{name}") if layer else None
    return {p.name for p in prim.properties} if prim else set()


def registered() -> dict[str, dict[str, set[str]]]:
    """Library → schema → the attributes and relationships that it brings itself."""
    found: dict[str, dict[str, set[str]]] = {}
    for library in LIBRARIES:
        plugin = Plug.Registry().GetPluginWithName(library[0].lower() + library[1:])
        found[library] = {}
        for type_name, entry in plugin.metadata["Types"].items():
            if not entry.get("schemaKind"):
                continue
            inherited = set()
            for ancestor in Tf.Type.FindByName(type_name).GetAllAncestorTypes()[1:]:
                inherited |= _properties(ancestor.typeName)
            found[library][_schema_name(type_name, entry)] = _properties(type_name) - inherited
    return found


def test_the_tables_name_every_schema_and_attribute_of_the_registry_and_no_others() -> None:
    tables, registry = documented(), registered()
    assert list(tables) == list(registry)
    for library, schemas in registry.items():
        assert set(tables[library]) == set(schemas), library
        for schema, attributes in schemas.items():
            assert set(tables[library][schema]) - {""} == attributes, schema


def test_every_status_is_one_that_the_page_explains() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for status in STATUSES:
        assert f"- **{status}**:" in text
    for schemas in documented().values():
        for schema, rows in schemas.items():
            for attribute, row in rows.items():
                assert row.status in STATUSES, (schema, attribute)
                assert row.note or row.status != "approximated", f"{schema}.{attribute}: in which way?"


CASES = [
    (schema, attribute)
    for library, schemas in documented().items()
    for schema, rows in schemas.items()
    if library != "UsdVol" and schema not in ELSEWHERE
    for attribute in rows
    if attribute
]


@pytest.fixture(scope="module")
def texture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("coverage") / "texture.exr"
    pixels = np.full((2, 4, 3), 0.5, np.float32)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), oiio.ImageSpec(4, 2, 3, "float"))
    assert out.write_image(pixels)
    out.close()
    return path


def _translated(schema: Schema, probe: str, texture: Path) -> tuple[str, list[str]]:
    """The scene as text, and the lines of its reports. probe: what is authored over the stage."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(
        f'#usda 1.0\n(upAxis = "Y")\ndef Xform "World" {{\n{schema.stage}\n}}\ndef Camera "view" {{ }}\n'
    )
    opinion = "#usda 1.0\n" + probe.replace("TEXTURE", str(texture))
    for name in reversed(schema.prim.strip("/").split("/")):
        head, _, body = opinion.partition("\n")
        opinion = f'{head}\nover "{name}" {{\n{body}\n}}'
    session = Sdf.Layer.CreateAnonymous(".usda")
    assert session.ImportFromString(opinion if probe else "#usda 1.0\n"), opinion
    stage = Usd.Stage.Open(layer, session)
    time = Usd.TimeCode.Default() if schema.time is None else Usd.TimeCode(schema.time)
    try:
        camera = "/World/camera" if stage.GetPrimAtPath("/World/camera") else "/view"
        translation = RenderIndex(stage, SyncOptions(camera=camera, time=time)).sync()
    except StageError as error:
        return "nothing to render", [str(error)]
    text = str(dump(translation))
    scene = [line for line in text.splitlines() if not line.strip().startswith("report ")]
    return "\n".join(scene), list(translation.reports.lines())


@pytest.mark.parametrize(("name", "attribute"), CASES)
def test_an_attribute_does_what_the_tables_say(name: str, attribute: str, texture: Path) -> None:
    schema = PROBES[name] if attribute in PROBES[name].probes else OTHERS[attribute]
    status = next(s[name] for s in documented().values() if name in s)[attribute].status
    before, old_reports = _translated(schema, "", texture)
    after, reports = _translated(schema, schema.probes[attribute], texture)
    if status in ("yes", "approximated"):
        assert after != before or reports != old_reports
        assert after != before or status == "approximated"
        return
    assert after == before
    if status == "no":
        assert any(schema.prim in line for line in reports), reports


@pytest.mark.parametrize("name", [n for n, rows in documented()["UsdVol"].items()])
def test_volumes_and_particle_fields_are_reported_by_name(name: str, texture: Path) -> None:
    rows = documented()["UsdVol"][name]
    assert {row.status for row in rows.values()} == {"no"}
    if name.endswith("API"):
        stage = f'def ParticleField "prim" (prepend apiSchemas = ["{name}"]) {{ }}\n'
        kind = "ParticleField"
    elif name in ABSTRACT:
        return  # there are no such prims
    elif "Asset" in name:
        stage = f'def Volume "prim" {{\nrel field:d = </World/f>\n}}\ndef {name} "f" {{ }}\n'
        kind = "Volume"
    else:
        stage, kind = f'def {name} "prim" {{ }}\n', name
    stage += 'def Plane "ground" { }\n'
    _, reports = _translated(Schema(stage, "/World/prim", {}), "", texture)
    assert any("/World/prim" in line and kind in line for line in reports), reports
