"""A stage as a whole: what is in the scene, what stops it, and what strict makes of errors."""

import pytest
from encore.errors import StageError
from encore.render_delegate import RenderDelegate
from encore.render_index import RenderIndex, SyncOptions
from encore.settings import SETTINGS
from pxr import Usd, UsdGeom, UsdLux
from stages import add_material, add_square, bind, instances, kinds, new_stage, translate


def test_counts(stage: Usd.Stage) -> None:
    bind(add_square(stage, "/World/A"), add_material(stage, "/World/Material"))
    add_square(stage, "/World/B")
    UsdLux.RectLight.Define(stage, "/World/Light")
    translation = translate(stage)
    translation.scene.validate()
    assert dict(translation.counts) == {
        "meshes": 2,
        "prototypes": 2,
        "instances": 2,
        "lights": 1,
        "materials": 2,
        "textures": 0,
    }


def test_options_have_defaults(stage: Usd.Stage) -> None:
    add_square(stage, "/World/A")
    translation = RenderIndex(stage).sync()
    assert (translation.width, translation.height) == (960, 700)
    assert translation.counts["lights"] == 1, "the camera light"


def test_sync_at_another_time(stage: Usd.Stage) -> None:
    operation = add_square(stage, "/World/A").AddTranslateOp()
    operation.Set((1, 0, 0), 1)
    operation.Set((2, 0, 0), 2)
    index = RenderIndex(stage, SyncOptions(time=Usd.TimeCode(1)))
    assert instances(index.sync())["/World/A"]["to_world"][3, 0] == 1
    assert instances(index.sync(Usd.TimeCode(2)))["/World/A"]["to_world"][3, 0] == 2


def test_types_go_by_hydras_names() -> None:
    assert {"mesh", "basisCurves", "points"} == set(RenderDelegate.SUPPORTED_RPRIM_TYPES)
    assert {"camera", "material", "distantLight"} <= set(RenderDelegate.SUPPORTED_SPRIM_TYPES)
    assert [s.key for s in RenderDelegate.render_setting_descriptors()] == list(SETTINGS)


@pytest.mark.parametrize("case", ["empty", "invisible", "purpose", "unsupported", "bad", "cut out"])
def test_nothing_to_render(case: str) -> None:
    stage = new_stage()
    if case == "unsupported":
        UsdGeom.HermiteCurves.Define(stage, "/World/Curves")
    elif case != "empty":
        mesh = add_square(stage, "/World/Mesh")
        if case == "invisible":
            mesh.MakeInvisible()
        elif case == "purpose":
            mesh.CreatePurposeAttr("guide")
        elif case == "bad":
            mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 17])
        else:
            bind(mesh, add_material(stage, "/World/M", opacity=0.0, opacityThreshold=0.5))
    with pytest.raises(StageError, match="no renderable prim") as error:
        translate(stage)
    says = {"unsupported": "HermiteCurves", "bad": "17", "invisible": "visibility"}.get(case, "")
    assert says in error.value.remedy


def test_broken_references_are_reported() -> None:
    stage = new_stage()
    add_square(stage, "/World/Good")
    stage.DefinePrim("/World/Bad").GetReferences().AddReference("./nothing.usda")
    translation = translate(stage)
    assert list(instances(translation)) == ["/World/Good"]
    (report,) = translation.reports.errors
    assert report.path == "/World/Bad" and "nothing.usda" in report.message
    with pytest.raises(StageError, match=r"nothing\.usda"):
        translate(stage, strict=True)


def test_strict_says_all_that_it_found() -> None:
    stage = new_stage()
    add_square(stage, "/World/Good")
    add_square(stage, "/World/Bad").CreateFaceVertexIndicesAttr([0, 1, 2, 17])
    UsdGeom.Cube.Define(stage, "/World/Flat").CreateSizeAttr(0.0)
    with pytest.raises(StageError, match=r"/World/Bad.*/World/Flat"):
        translate(stage, strict=True)


def test_strict_lets_what_is_merely_unsupported_pass(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Good")
    UsdGeom.HermiteCurves.Define(stage, "/World/Curves")
    assert kinds(translate(stage, strict=True))["unsupported HermiteCurves"] == 1


def test_a_population_mask(stage: Usd.Stage) -> None:
    for name in ("A", "B"):
        add_square(stage, f"/World/{name}")
    mask = Usd.StagePopulationMask(["/World/B"])
    masked = Usd.Stage.OpenMasked(stage.GetRootLayer(), mask)
    assert list(instances(translate(masked))) == ["/World/B"]
