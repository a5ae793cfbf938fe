"""What notices of a stage make dirty."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable

import pytest
from encore.change_tracker import ChangeTracker, DirtyBits, dirty_bits
from pxr import Sdf, Usd, UsdGeom, UsdShade
from stages import add_material, add_square, bind, surface

MESH = Sdf.Path("/World/Mesh")


@pytest.fixture
def tracker(stage: Usd.Stage) -> ChangeTracker:
    """Of a stage with the square /World/Mesh, bound to /World/Material; all clean."""
    mesh = add_square(stage, str(MESH))
    mesh.AddTranslateOp().Set((0, 0, 0))
    mesh.CreateVisibilityAttr("inherited")
    mesh.CreatePurposeAttr("default")
    mesh.CreateDisplayColorAttr([(1, 0, 0)])
    mesh.CreateNormalsAttr([(0, 0, 1)] * 4)
    mesh.CreateDoubleSidedAttr(False)
    mesh.CreateExtentAttr([(0, 0, 0), (1, 1, 0)])
    mesh.CreateCreaseIndicesAttr([0, 1])
    bind(mesh, add_material(stage, "/World/Material", roughness=0.5))
    add_material(stage, "/World/Other")
    tracker = ChangeTracker(stage)
    assert tracker.changes.everything, "nothing is known at first"
    tracker.take()
    assert not tracker.changes
    return tracker


@pytest.mark.parametrize(
    ("edit", "bits"),
    [
        (lambda m: m.GetVisibilityAttr().Set("invisible"), DirtyBits.VISIBILITY),
        (lambda m: m.GetPurposeAttr().Set("proxy"), DirtyBits.RENDER_TAG),
        (lambda m: m.GetOrderedXformOps()[0].Set((1, 2, 3)), DirtyBits.TRANSFORM),
        (lambda m: m.SetXformOpOrder([]), DirtyBits.TRANSFORM),
        (lambda m: m.GetPointsAttr().Set([(0, 0, 0)] * 4), DirtyBits.POINTS),
        (lambda m: m.GetPointsAttr().Set([(0, 0, 0)] * 4, 2.0), DirtyBits.POINTS),
        (lambda m: m.GetFaceVertexIndicesAttr().Set([3, 2, 1, 0]), DirtyBits.TOPOLOGY),
        (lambda m: m.GetSubdivisionSchemeAttr().Set("loop"), DirtyBits.TOPOLOGY),
        (lambda m: m.GetNormalsAttr().Set([(0, 1, 0)] * 4), DirtyBits.NORMALS),
        (lambda m: m.GetDoubleSidedAttr().Set(True), DirtyBits.DOUBLE_SIDED),
        (lambda m: m.GetExtentAttr().Set([(0, 0, 0), (2, 2, 2)]), DirtyBits.EXTENT),
        (lambda m: m.GetCreaseIndicesAttr().Set([1, 2]), DirtyBits.SUBDIV_TAGS),
        (lambda m: m.GetDisplayColorPrimvar().Set([(0, 1, 0)]), DirtyBits.PRIMVAR),
        (lambda m: m.GetDisplayColorPrimvar().SetInterpolation("uniform"), DirtyBits.PRIMVAR),
        (
            lambda m: UsdShade.MaterialBindingAPI(m).GetDirectBindingRel().SetTargets(["/World/Other"]),
            DirtyBits.MATERIAL_ID | DirtyBits.CATEGORIES,
        ),
    ],
)
def test_changed_properties(
    stage: Usd.Stage, tracker: ChangeTracker, edit: Callable[[UsdGeom.Mesh], object], bits: DirtyBits
) -> None:
    edit(UsdGeom.Mesh.Get(stage, MESH))
    changes = tracker.take()
    assert changes.prims == {MESH: bits} and not changes.resynced and not changes.everything
    assert not tracker.changes, "what is taken is clean"


def test_names_that_nothing_is_known_of_may_be_anything() -> None:
    assert dirty_bits("model:drawMode") == DirtyBits.ALL
    assert dirty_bits("xformOp:rotateXYZ:pivot") == DirtyBits.TRANSFORM
    assert dirty_bits("primvars:st:indices") == DirtyBits.PRIMVAR
    assert dirty_bits("collection:lightLink:includes") == DirtyBits.CATEGORIES


def test_bits_of_several_edits_are_gathered(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    mesh = UsdGeom.Mesh.Get(stage, MESH)
    mesh.GetVisibilityAttr().Set("invisible")
    mesh.GetPointsAttr().Set([(0, 0, 0)] * 4)
    assert tracker.dirty_bits(MESH) == DirtyBits.VISIBILITY | DirtyBits.POINTS
    assert tracker.dirty_bits(Sdf.Path("/World/Material")) == DirtyBits.CLEAN
    tracker.mark_dirty(MESH, DirtyBits.TOPOLOGY)
    assert tracker.take().having(DirtyBits.TOPOLOGY) == {MESH}


def test_shaders_are_prims_of_their_own(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    surface(UsdShade.Material.Get(stage, "/World/Material")).GetInput("roughness").Set(0.1)
    assert tracker.take().prims == {Sdf.Path("/World/Material/Surface"): DirtyBits.PARAMS}


def test_properties_that_come_or_go(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    UsdGeom.Mesh.Get(stage, MESH).CreateHoleIndicesAttr([0])
    changes = tracker.take()
    assert changes.prims == {MESH: DirtyBits.TOPOLOGY} and changes.renamed == {MESH}
    stage.GetPrimAtPath(MESH).RemoveProperty("holeIndices")
    assert tracker.take().renamed == {MESH}


def test_prims_that_come_or_go_are_resynced(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    stage.GetPrimAtPath(MESH).SetActive(False)
    changes = tracker.take()
    assert changes.resynced == {MESH} and changes.bits == DirtyBits.ALL
    add_square(stage, "/World/New")
    assert Sdf.Path("/World/New") in tracker.changes.resynced
    assert tracker.dirty_bits(Sdf.Path("/World/New/Below")) == DirtyBits.ALL


def test_what_holds_for_the_whole_stage(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    assert tracker.take().everything
    stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    assert tracker.take().everything
    tracker.mark_all_dirty()
    assert tracker.dirty_bits(MESH) == DirtyBits.ALL


def test_words_for_people_change_nothing(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    prim = stage.GetPrimAtPath(MESH)
    prim.SetDocumentation("a square")
    prim.SetCustomDataByKey("note", "ours")
    stage.SetMetadata("comment", "a stage")
    stage.SetStartTimeCode(3)
    assert not tracker.take()


def test_other_stages_are_not_listened_to(tracker: ChangeTracker) -> None:
    add_square(Usd.Stage.CreateInMemory(), "/World/Mesh")
    assert not tracker.changes


def test_a_tracker_is_not_kept_by_its_stage(stage: Usd.Stage) -> None:
    gone = weakref.ref(ChangeTracker(stage))
    gc.collect()
    assert gone() is None
    add_square(stage, "/World/Later")


def test_a_closed_tracker_hears_nothing(stage: Usd.Stage, tracker: ChangeTracker) -> None:
    tracker.close()
    add_square(stage, "/World/Later")
    assert not tracker.changes
