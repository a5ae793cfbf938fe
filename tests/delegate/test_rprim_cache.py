"""What is known of rprims: their primvars are those that USD finds."""

from __future__ import annotations

import pytest
from encore.render_index import RenderIndex
from pxr import Sdf, Usd, UsdGeom

FLOAT, FLOATS = Sdf.ValueTypeNames.Float, Sdf.ValueTypeNames.FloatArray


def _stage(above: bool) -> Usd.Stage:
    """A mesh with primvars of all kinds. above: its parent has those of the same names as well."""
    stage = Usd.Stage.CreateInMemory()
    parent = UsdGeom.Xform.Define(stage, "/Parent").GetPrim()
    if above:
        for name in ("passed", "blocked", "declared", "own", "unset", "blockedArray"):
            UsdGeom.PrimvarsAPI(parent).CreatePrimvar(name, FLOAT).Set(1.0)
    mesh = UsdGeom.Mesh.Define(stage, "/Parent/Mesh")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    own = UsdGeom.PrimvarsAPI(mesh)
    own.CreatePrimvar("blocked", FLOAT).GetAttr().Block()
    own.CreatePrimvar("declared", FLOAT)
    own.CreatePrimvar("own", FLOATS, "vertex").Set([1, 2, 3])
    own.CreatePrimvar("unset", FLOATS, "vertex")
    own.CreatePrimvar("blockedArray", FLOATS, "vertex").GetAttr().Block()
    own.CreatePrimvar("sampled", FLOAT).Set(1.0, 5.0)
    own.CreatePrimvar("deep:name", FLOAT).Set(1.0)
    indexed = own.CreatePrimvar("indexed", FLOATS, "vertex")
    indexed.Set([1])
    indexed.SetIndices([0, 0, 0])
    mesh.GetPrim().CreateRelationship("primvars:related").SetTargets(["/Parent"])
    return stage


@pytest.mark.parametrize("above", [False, True])
def test_primvars_are_those_that_usd_finds(above: bool) -> None:
    stage = _stage(above)
    index = RenderIndex(stage)
    index.sync()
    (rprim,) = index._parts.root.rprims
    found = index._parts.rprims.primvars(rprim)
    expected = UsdGeom.PrimvarsAPI(rprim.prim).FindPrimvarsWithInheritance()
    assert {name: p.GetAttr().GetPath() for name, p in found.items()} == {
        str(p.GetPrimvarName()): p.GetAttr().GetPath() for p in expected
    }
    assert {"own", "sampled", "deep:name", "indexed"} <= found.keys()
    assert ("passed" in found) is above
