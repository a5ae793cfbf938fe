"""What is not supported is reported by name, once with a count, and fails no strict run."""

import pytest
from encore.render_index import Translation
from pxr import Sdf, Usd, UsdGeom, UsdProc, UsdShade, UsdVol, Vt
from stages import add_instance, add_material, add_point_instancer, add_square, bind, instances, translate

TYPES = (
    "HermiteCurves",
    "NurbsCurves",
    "NurbsPatch",
    "TetMesh",
    "Volume",
    "ParticleField",
    "ParticleField3DGaussianSplat",
    "GenerativeProcedural",
)


def reported(translation: Translation, kind: str) -> str:
    """The one line that a kind has."""
    (report,) = [r for r in translation.reports if r.kind == kind]
    return report.line()


@pytest.mark.parametrize("name", TYPES)
def test_geometry_of_other_types(stage: Usd.Stage, name: str) -> None:
    """Prims below are rendered all the same; those that are not wanted are not told of."""
    assert UsdVol and UsdProc, "their schemas are known"
    add_square(stage, "/World/Good")
    for i in range(3):
        prim = stage.DefinePrim(f"/World/P{i}", name)
        assert prim.IsA(UsdGeom.Boundable)
    add_square(stage, "/World/P0/Below")
    UsdGeom.Imageable(stage.DefinePrim("/World/Guide", name)).CreatePurposeAttr("guide")
    UsdGeom.Imageable(stage.DefinePrim("/World/Hidden", name)).CreateVisibilityAttr("invisible")
    translation = translate(stage, strict=True)
    line = f"Warning: /World/P0: {name} is not supported yet, and is not rendered (3 prims)."
    assert reported(translation, f"unsupported {name}") == line
    assert sorted(instances(translation)) == ["/World/Good", "/World/P0/Below"]


@pytest.mark.parametrize("field", ["OpenVDBAsset", "Field3DAsset"])
def test_volumes_are_told_of_once_with_their_fields(stage: Usd.Stage, field: str) -> None:
    add_square(stage, "/World/Good")
    volume = UsdVol.Volume.Define(stage, "/World/Smoke")
    stage.DefinePrim("/World/Smoke/Density", field)
    volume.CreateFieldRelationship("density", "/World/Smoke/Density")
    lines = [line for line in translate(stage, strict=True).reports.lines() if "/World/Smoke" in line]
    assert lines == ["Warning: /World/Smoke: Volume is not supported yet, and is not rendered."]


@pytest.mark.parametrize("name", TYPES)
def test_in_prototypes(stage: Usd.Stage, name: str) -> None:
    """Told once for what instances share."""
    add_square(stage, "/Asset/Mesh")
    stage.DefinePrim("/Asset/Other", name)
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for i in range(3):
        add_instance(stage, f"/World/I{i}")
    translation = translate(stage, strict=True)
    assert reported(translation, f"unsupported {name}").startswith("Warning: /World/I0/Other:")
    assert len(instances(translation)) == 3


@pytest.mark.parametrize("mode", ["cards", "bounds", "origin"])
def test_draw_modes(stage: Usd.Stage, mode: str) -> None:
    """The full geometry is rendered, of instances and instancers too."""
    add_square(stage, "/World/Plain/Mesh")
    add_square(stage, "/Asset/Mesh")
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    instance = add_instance(stage, "/World/Instance")
    add_square(stage, "/World/Instancer/A")
    instancer = add_point_instancer(stage, "/World/Instancer", ["/World/Instancer/A"], [0])
    for prim in (stage.GetPrimAtPath("/World/Plain"), instance, instancer.GetPrim()):
        Usd.ModelAPI(prim).SetKind("component")
        UsdGeom.ModelAPI.Apply(prim).CreateModelDrawModeAttr(mode)
    translation = translate(stage, strict=True)
    line = reported(translation, "draw mode")
    assert f"draw mode {mode} is not supported yet" in line and line.endswith("(3 prims).")
    assert len(instances(translation)) == 3


@pytest.mark.parametrize("mode", ["default", "inherited"])
def test_the_usual_draw_mode_is_not_told_of(stage: Usd.Stage, mode: str) -> None:
    add_square(stage, "/World/Plain/Mesh")
    UsdGeom.ModelAPI.Apply(stage.GetPrimAtPath("/World/Plain")).CreateModelDrawModeAttr(mode)
    assert not any(r.kind == "draw mode" for r in translate(stage).reports)


@pytest.mark.parametrize("element", ["point", "edge", "tetrahedron", "segment"])
def test_materials_of_subsets_of_what_is_no_face(stage: Usd.Stage, element: str) -> None:
    mesh = add_square(stage, "/World/Mesh")
    for i in range(2):
        subset = UsdGeom.Subset.Define(stage, f"/World/Mesh/S{i}")
        subset.CreateElementTypeAttr(element)
        subset.CreateFamilyNameAttr(UsdShade.Tokens.materialBind)
        subset.CreateIndicesAttr(Vt.IntArray([0, 1]))
        bind(subset, add_material(stage, "/World/Material"))
    line = reported(translate(stage, strict=True), f"subset of {element}s")
    assert line.startswith("Warning: /World/Mesh/S0:") and line.endswith("(2 prims).")
    assert mesh.GetPointsAttr().Get()


def test_subsets_of_other_families_have_no_effect(stage: Usd.Stage) -> None:
    """They mean nothing to a renderer, and nothing is said of them."""
    add_square(stage, "/World/Mesh")
    subset = UsdGeom.Subset.Define(stage, "/World/Mesh/Subset")
    subset.CreateElementTypeAttr("point")
    subset.CreateFamilyNameAttr("simulation")
    subset.CreateIndicesAttr(Vt.IntArray([0, 1]))
    assert not [line for line in translate(stage, strict=True).reports.lines() if "Subset" in line]


def test_levels_of_detail(stage: Usd.Stage) -> None:
    root = stage.DefinePrim("/World/Tree", "Xform")
    root.AddAppliedSchema("LODRootAPI")
    root.CreateRelationship("lod:heuristics").SetTargets(["/World/Heuristic"])
    stage.DefinePrim("/World/Heuristic", "LODDistanceHeuristic")
    for name in ("Near", "Far"):
        add_square(stage, f"/World/Tree/{name}")
    translation = translate(stage, strict=True)
    assert "levels of detail are not supported" in reported(translation, "unsupported LODRootAPI")
    assert len(instances(translation)) == 2
