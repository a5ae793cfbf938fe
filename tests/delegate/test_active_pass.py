"""RenderPasses: which settings they render, and what they make of the stage."""

from __future__ import annotations

import pytest
from encore.active_pass import activate_pass, read_pass
from encore.errors import SettingError, StageError
from encore.report import Reports
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdRender

PASS = "/Render/Pass"


@pytest.fixture
def made(stage: Usd.Stage) -> UsdRender.Pass:
    """A pass of a stage with two groups of cubes, a lamp, and two instances of a cube and a sphere."""
    UsdGeom.Xform.Define(stage, "/World/A")
    for path in ("/World/A/X", "/World/A/Y", "/World/B/X"):
        UsdGeom.Cube.Define(stage, path)
    UsdLux.SphereLight.Define(stage, "/World/Lamp")
    UsdGeom.Cube.Define(stage, "/Prototype/Cube")
    UsdGeom.Sphere.Define(stage, "/Prototype/Ball")
    for name in ("I", "J"):
        prim = stage.DefinePrim(f"/World/{name}")
        prim.GetReferences().AddInternalReference("/Prototype")
        prim.SetInstanceable(True)
    UsdRender.Settings.Define(stage, "/Render/Settings")
    render_pass = UsdRender.Pass.Define(stage, PASS)
    render_pass.CreateRenderSourceRel().SetTargets(["/Render/Settings"])
    return render_pass


def collection(made: UsdRender.Pass, name: str) -> Usd.CollectionAPI:
    return Usd.CollectionAPI(made.GetPrim(), name)


def activate(made: UsdRender.Pass) -> Reports:
    reports = Reports()
    activate_pass(made.GetPrim().GetStage(), PASS, reports)
    return reports


def shown(stage: Usd.Stage) -> list[str]:
    """Paths of visible geometry and lights below /World, without /World/."""
    found = Usd.PrimRange(stage.GetPrimAtPath("/World"), Usd.TraverseInstanceProxies())
    prims = [p for p in found if p.IsA(UsdGeom.Gprim) or p.HasAPI(UsdLux.LightAPI)]
    visible = [p for p in prims if UsdGeom.Imageable(p).ComputeVisibility() != "invisible"]
    return [str(p.GetPath()).removeprefix("/World/") for p in visible]


EVERYTHING = ["A/X", "A/Y", "B/X", "Lamp", "I/Cube", "I/Ball", "J/Cube", "J/Ball"]


def test_a_pass_without_collections_leaves_the_stage_alone(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    session = stage.GetSessionLayer().ExportToString()
    assert activate_pass(stage, PASS, Reports()) is None
    assert stage.GetSessionLayer().ExportToString() == session
    assert shown(stage) == EVERYTHING


def test_what_is_pruned_is_not_on_the_stage(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    before = stage.GetRootLayer().ExportToString()
    collection(made, "prune").CreateIncludesRel().SetTargets(["/World/A", "/World/Lamp", "/World/J"])
    after = stage.GetRootLayer().ExportToString()
    assert before != after
    activate(made)
    assert shown(stage) == ["B/X", "I/Cube", "I/Ball"]
    assert not stage.GetPrimAtPath("/World/A").IsActive()
    assert stage.GetRootLayer().ExportToString() == after, "nothing of it reaches the stage's own layers"


def test_what_is_excluded_from_pruning_below_stays_pruned(made: UsdRender.Pass) -> None:
    """A prim that is gone has no descendants."""
    prune = collection(made, "prune")
    prune.CreateIncludesRel().SetTargets(["/World/A"])
    prune.CreateExcludesRel().SetTargets(["/World/A/Y"])
    activate(made)
    assert shown(made.GetPrim().GetStage()) == EVERYTHING[2:]


def test_parts_of_instances_can_be_pruned(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    collection(made, "prune").CreateIncludesRel().SetTargets(["/World/J/Ball"])
    activate(made)
    assert shown(stage) == [name for name in EVERYTHING if name != "J/Ball"]
    assert stage.GetPrimAtPath("/World/I").IsInstance(), "the others still share"


def test_what_is_not_in_the_visible_collection_is_hidden(made: UsdRender.Pass) -> None:
    collection(made, "renderVisibility").CreateExcludesRel().SetTargets(["/World/A/X", "/World/Lamp"])
    activate(made)
    assert shown(made.GetPrim().GetStage()) == [n for n in EVERYTHING if n not in ("A/X", "Lamp")]


def test_only_what_is_included_is_visible(made: UsdRender.Pass) -> None:
    visible = collection(made, "renderVisibility")
    visible.CreateIncludeRootAttr(False)
    visible.CreateIncludesRel().SetTargets(["/World/A/Y", "/World/I/Ball"])
    activate(made)
    assert shown(made.GetPrim().GetStage()) == ["A/Y", "I/Ball"]


def test_prims_that_refer_to_what_is_pruned_or_hidden_stay(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    collection(made, "prune").CreateIncludesRel().SetTargets(["/Prototype/Cube"])
    collection(made, "renderVisibility").CreateExcludesRel().SetTargets(["/Prototype/Ball"])
    activate(made)
    assert shown(stage) == EVERYTHING
    assert not stage.GetPrimAtPath("/Prototype/Cube").IsActive()
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/Prototype/Ball")).ComputeVisibility() == "invisible"


def test_a_whole_library_can_be_pruned(made: UsdRender.Pass) -> None:
    collection(made, "prune").CreateIncludesRel().SetTargets(["/Prototype"])
    activate(made)
    assert shown(made.GetPrim().GetStage()) == EVERYTHING


def test_visibility_that_changes_with_time_is_kept(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    ball = UsdGeom.Imageable(stage.GetPrimAtPath("/Prototype/Ball"))
    for time, value in ((1, "invisible"), (2, "inherited")):
        ball.GetVisibilityAttr().Set(value, time)
    collection(made, "renderVisibility").CreateExcludesRel().SetTargets(["/Prototype", "/World/J"])
    activate(made)
    found = UsdGeom.Imageable(stage.GetPrimAtPath("/World/I/Ball"))
    assert [found.ComputeVisibility(time) for time in (1, 2)] == ["invisible", "inherited"]
    assert ball.ComputeVisibility(2) == "invisible"


def test_a_pass_follows_another(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    includes = collection(made, "prune").CreateIncludesRel()
    for target, left in (("/World/A", EVERYTHING[2:]), ("/World/B", [n for n in EVERYTHING if n != "B/X"])):
        includes.SetTargets([target])
        activate(made)
        assert shown(stage) == left
    includes.ClearTargets(True)
    activate(made)
    assert shown(stage) == EVERYTHING
    assert not stage.GetSessionLayer().subLayerPaths


def test_a_pattern_says_what_is_visible(made: UsdRender.Pass) -> None:
    visible = collection(made, "renderVisibility")
    visible.CreateIncludeRootAttr(False)
    visible.CreateMembershipExpressionAttr(Sdf.PathExpression("/World//X"))
    activate(made)
    assert shown(made.GetPrim().GetStage()) == ["A/X", "B/X"]


def test_what_is_invisible_stays_so(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible()
    visible = collection(made, "renderVisibility")
    visible.CreateIncludeRootAttr(False)
    visible.CreateIncludesRel().SetTargets(["/World/A", "/World/B"])
    activate(made)
    assert shown(stage) == ["B/X"]


def test_a_point_instancer_is_hidden_with_what_it_places(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Many")
    UsdGeom.Cube.Define(stage, "/World/Many/Cube")
    collection(made, "renderVisibility").CreateExcludesRel().SetTargets(["/World/Many"])
    activate(made)
    assert instancer.ComputeVisibility() == "invisible"
    spec = stage.GetPrimAtPath("/World/Many/Cube").GetAttribute("visibility")
    assert not spec.HasAuthoredValue(), "its prototypes may be placed by others"


def test_collections_that_are_not_supported_are_reported_by_name(made: UsdRender.Pass) -> None:
    collection(made, "cameraVisibility").CreateExcludesRel().SetTargets(["/World/A"])
    collection(made, "matte").CreateIncludesRel().SetTargets(["/World/B"])
    text = " ".join(activate(made).lines())
    assert "cameraVisibility" in text and "matte" in text
    assert shown(made.GetPrim().GetStage()) == EVERYTHING


def test_the_source_of_a_pass(made: UsdRender.Pass) -> None:
    stage, reports = made.GetPrim().GetStage(), Reports()
    made.CreatePassTypeAttr("usdRender")
    made.CreateInputPassesRel().SetTargets(["/Render/Other"])
    made.CreateCommandAttr(["husk", "{fileName}"])
    assert read_pass(stage, PASS, reports).settings == "/Render/Settings"
    assert {r.kind for r in reports} == {"inputPasses", "command"}
    made.GetRenderSourceRel().SetTargets(["/World"])
    with pytest.raises(SettingError, match=r"/Render/Pass\.renderSource: /World is no RenderSettings"):
        read_pass(stage, PASS, reports)
    made.GetRenderSourceRel().ClearTargets(True)
    with pytest.raises(SettingError, match="it has no source"):
        read_pass(stage, PASS, reports)


def test_passes_of_other_programs(made: UsdRender.Pass) -> None:
    stage = made.GetPrim().GetStage()
    made.CreateFileNameAttr("comp.nk")
    with pytest.raises(SettingError, match=r"fileName: its source is in another file \(comp.nk\)"):
        read_pass(stage, PASS, Reports())
    made.CreatePassTypeAttr("nuke")
    with pytest.raises(SettingError, match=r"passType: passes of type 'nuke'"):
        read_pass(stage, PASS, Reports())
    with pytest.raises(StageError, match="Choose one of: /Render/Pass"):
        read_pass(stage, "/Render/Settings", Reports())


def test_a_deactivated_pass_is_none(stage: Usd.Stage, made: UsdRender.Pass) -> None:
    made.GetPrim().SetActive(False)
    with pytest.raises(StageError, match="is no RenderPass"):
        read_pass(stage, PASS, Reports())
