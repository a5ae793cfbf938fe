"""Shading rates: inheritance, layers, instances, and values that are none."""

from typing import Any

import numpy as np
import pytest
from encore.adapters.shading_rate import combine
from encore.dump import dump
from encore.errors import StageError
from encore.render_index import Translation
from pxr import Gf, Sdf, Usd, UsdGeom
from stages import add_instance, add_point_instancer, add_square, instances, meshes, translate

RATE = "encore:shadingRate"
NO_RATE = (0, 0, 0)


def say(prim: Any, value: float, layer: str = "") -> UsdGeom.Primvar:
    """Authors a constant rate, for one layer or for all."""
    name = f"{RATE}:{layer}" if layer else RATE
    primvar = UsdGeom.PrimvarsAPI(prim.GetPrim()).CreatePrimvar(name, Sdf.ValueTypeNames.Float)
    primvar.Set(value)
    return primvar


def say_per_instance(prim: Any, values: list[float], interpolation: str, layer: str = "") -> UsdGeom.Primvar:
    name = f"{RATE}:{layer}" if layer else RATE
    api = UsdGeom.PrimvarsAPI(prim.GetPrim())
    primvar = api.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, interpolation)
    primvar.Set(values)
    return primvar


def rates(translation: Translation) -> dict[str, list[tuple[float, ...]]]:
    """What each instance shows: per mesh, the instance's rate where it is above 0, else the mesh's."""
    scene = translation.scene
    return {
        path: [
            tuple(
                i or m for i, m in zip(placed["shading_rate"], scene.mesh(mesh)["shading_rate"], strict=True)
            )
            for mesh in scene.prototype(placed["prototype"])["meshes"]
        ]
        for path, placed in instances(translation).items()
    }


def errors(translation: Translation) -> list[str]:
    return [report.line() for report in translation.reports.errors]


def add_asset(stage: Usd.Stage, meshes: int = 1, path: str = "/Asset") -> None:
    stage.CreateClassPrim(path)
    for i in range(meshes):
        add_square(stage, f"{path}/M{i}")


# --- Prims -------------------------------------------------------------------------------------------


def test_rates_are_inherited_and_layers_have_their_own(stage: Usd.Stage) -> None:
    for path in ("/World/A", "/World/A/B", "/World/A/C", "/World/A/D"):
        add_square(stage, path)
    say(stage.GetPrimAtPath("/World"), 4, "reflection")
    say(stage.GetPrimAtPath("/World/A"), 2)
    say(stage.GetPrimAtPath("/World/A/B"), 0.25)
    say(stage.GetPrimAtPath("/World/A/C"), 8, "direct")
    say(stage.GetPrimAtPath("/World/A/C"), 16, "refraction")
    for layer in ("", "reflection"):
        say(stage.GetPrimAtPath("/World/A/D"), 0, layer)
    found = {path: mesh["shading_rate"] for path, mesh in meshes(translate(stage)).items()}
    assert found == {
        "/World/A": (2, 4, 2),
        "/World/A/B": (0.25, 4, 0.25),
        "/World/A/C": (8, 4, 16),
        "/World/A/D": NO_RATE,
    }


def test_a_rate_is_read_at_the_frames_time(stage: Usd.Stage) -> None:
    primvar = say(add_square(stage, "/World/Mesh"), 1)
    primvar.Set(2.0, 10)
    primvar.Set(6.0, 20)
    found = translate(stage, time=Usd.TimeCode(15))
    assert meshes(found)["/World/Mesh"]["shading_rate"] == (4, 4, 4)


def test_the_schemas_fallback_says_nothing(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    mesh.GetPrim().AddAppliedSchema("EncorePrimvarsAPI")
    translation = translate(stage)
    assert meshes(translation)["/World/Mesh"]["shading_rate"] == NO_RATE
    assert errors(translation) == []


def test_the_largest_rate_is_allowed(stage: Usd.Stage) -> None:
    say(add_square(stage, "/World/Mesh"), 256)
    assert meshes(translate(stage))["/World/Mesh"]["shading_rate"] == (256, 256, 256)


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        ("Float", -1.0, "-1 is not a number from 0 to 256"),
        ("Float", float("nan"), "nan is not a number"),
        ("Float", float("inf"), "inf is not a number"),
        ("Double", 1e300, "1e+300 is not a number"),
        ("Float", 256.5, "256.5 is not a number"),
        ("String", "fast", "type string, not float"),
        ("Bool", True, "type bool, not float"),
        ("Float2", Gf.Vec2f(1, 2), "2 values where one is needed"),
        ("FloatArray", [1.0, 2.0], "2 values where one is needed"),
        ("FloatArray", [], "0 values where one is needed"),
        ("Matrix2d", Gf.Matrix2d(1), "type matrix2d, not float"),
    ],
)
def test_bad_rates_are_reported_where_they_are(stage: Usd.Stage, kind: str, value: Any, message: str) -> None:
    group = UsdGeom.Xform.Define(stage, "/World/Group")
    for i in range(2):
        add_square(stage, f"/World/Group/M{i}")
    say(stage.GetPrimAtPath("/World"), 2)
    api = UsdGeom.PrimvarsAPI(group.GetPrim())
    api.CreatePrimvar(f"{RATE}:reflection", getattr(Sdf.ValueTypeNames, kind)).Set(value)
    translation = translate(stage)
    (line,) = errors(translation)
    assert line.startswith(f"Error: /World/Group: primvar {RATE}:reflection is ignored: it")
    assert message in line
    assert all(mesh["shading_rate"] == (2, 2, 2) for mesh in meshes(translation).values())
    with pytest.raises(StageError, match="/World/Group"):
        translate(stage, strict=True)


def test_a_rate_that_varies_over_a_mesh_is_refused(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    say_per_instance(mesh, [1, 2, 3, 4], "vertex")
    translation = translate(stage)
    (line,) = errors(translation)
    assert line.startswith("Error: /World/Mesh: ")
    assert "vertex interpolation, not constant" in line
    assert meshes(translation)["/World/Mesh"]["shading_rate"] == NO_RATE


def test_whole_numbers_and_halves_are_numbers(stage: Usd.Stage) -> None:
    api = UsdGeom.PrimvarsAPI(add_square(stage, "/World/Mesh").GetPrim())
    api.CreatePrimvar(f"{RATE}:direct", Sdf.ValueTypeNames.Int).Set(3)
    api.CreatePrimvar(f"{RATE}:reflection", Sdf.ValueTypeNames.Half).Set(0.5)
    api.CreatePrimvar(f"{RATE}:refraction", Sdf.ValueTypeNames.FloatArray).Set([7])
    translation = translate(stage)
    assert meshes(translation)["/World/Mesh"]["shading_rate"] == (3, 0.5, 7)
    assert errors(translation) == []


def test_shapes_of_different_rates_share_their_geometry(stage: Usd.Stage) -> None:
    for i in range(3):
        sphere = UsdGeom.Sphere.Define(stage, f"/World/S{i}")
        if i:
            say(sphere, i)
    translation = translate(stage)
    assert translation.counts["meshes"] == 1
    assert rates(translation) == {f"/World/S{i}": [(i, i, i)] for i in range(3)}


# --- Native instances --------------------------------------------------------------------------------


def test_instances_with_rates_share_a_prototype(stage: Usd.Stage) -> None:
    add_asset(stage, 2)
    UsdGeom.Xform.Define(stage, "/World/Fine")
    say(stage.GetPrimAtPath("/World/Fine"), 8)
    say(stage.GetPrimAtPath("/World/Fine"), 16, "refraction")
    # The first one is walked for all, and its rate must not stay with the meshes.
    say(add_instance(stage, "/World/Fine/A"), 1)
    add_instance(stage, "/World/Fine/B")
    add_instance(stage, "/World/C")
    say(add_instance(stage, "/World/D"), 0.5, "reflection")
    translation = translate(stage)
    assert translation.counts["meshes"] == 2
    assert rates(translation) == {
        "/World/Fine/A": [(1, 1, 16)] * 2,
        "/World/Fine/B": [(8, 8, 16)] * 2,
        "/World/C": [NO_RATE] * 2,
        "/World/D": [(0, 0.5, 0)] * 2,
    }


def test_what_a_prototype_says_wins_over_what_its_instances_inherit(stage: Usd.Stage) -> None:
    add_asset(stage, 2)
    say(stage.GetPrimAtPath("/Asset/M0"), 4)
    say(stage.GetPrimAtPath("/World"), 2)
    add_instance(stage, "/World/A")
    UsdGeom.Xform.Define(stage, "/World/Coarse")
    say(stage.GetPrimAtPath("/World/Coarse"), 0.5)
    add_instance(stage, "/World/Coarse/B")
    translation = translate(stage)
    assert rates(translation) == {
        "/World/A": [(4, 4, 4), (2, 2, 2)],
        "/World/Coarse/B": [(4, 4, 4), (0.5, 0.5, 0.5)],
    }


def test_what_an_instance_says_itself_wins_over_its_prototype(stage: Usd.Stage) -> None:
    add_asset(stage, 2)
    say(stage.GetPrimAtPath("/Asset/M0"), 4)
    say(stage.GetPrimAtPath("/World"), 2, "refraction")
    say(add_instance(stage, "/World/A"), 1)
    say(add_instance(stage, "/World/B"), 8, "direct")
    add_instance(stage, "/World/C")
    translation = translate(stage)
    assert rates(translation) == {
        "/World/A": [(1, 1, 2), (1, 1, 2)],
        "/World/B": [(8, 4, 2), (8, 0, 2)],
        "/World/C": [(4, 4, 2), (0, 0, 2)],
    }


def test_instances_in_instances(stage: Usd.Stage) -> None:
    add_asset(stage)
    stage.CreateClassPrim("/Group")
    add_instance(stage, "/Group/Plain")
    say(add_instance(stage, "/Group/Own"), 4)
    add_square(stage, "/Group/Mesh")
    add_instance(stage, "/World/A", "/Group")
    say(add_instance(stage, "/World/B", "/Group"), 1, "direct")
    translation = translate(stage)
    assert rates(translation) == {
        "/World/A": [NO_RATE],
        "/World/A/Plain": [NO_RATE],
        "/World/A/Own": [(4, 4, 4)],
        "/World/B": [(1, 0, 0)],
        "/World/B/Plain": [(1, 0, 0)],
        "/World/B/Own": [(1, 4, 4)],
    }


def test_bad_rates_of_instances(stage: Usd.Stage) -> None:
    add_asset(stage)
    for i in range(2):
        say(add_instance(stage, f"/World/I{i}"), -2)
    translation = translate(stage)
    (line,) = errors(translation)
    assert line.startswith("Error: /World/I0: ")
    assert "(2 prims)" in line
    assert set(map(tuple, rates(translation).values())) == {(NO_RATE,)}


def expected_rate(mesh: Usd.Prim) -> tuple[float, ...]:
    """The rule, with nothing shared. By name the nearest prim at or above speaks, and an instance overrules.

    Of several instances above the mesh the outermost that speaks of a layer overrules.
    """
    names = [f"primvars:{RATE}{suffix}" for suffix in ("", ":direct", ":reflection", ":refraction")]

    def own(prim: Usd.Prim, name: str) -> float | None:
        return prim.GetAttribute(name).Get()

    def inherited(prim: Usd.Prim, name: str) -> float:
        while prim and own(prim, name) is None:
            prim = prim.GetParent()
        return own(prim, name) or 0.0 if prim else 0.0

    def resolved(prim: Usd.Prim, name: str) -> float:
        return inherited(prim, name) or inherited(prim, names[0])

    above = [mesh]
    while above[-1].GetParent():
        above.append(above[-1].GetParent())
    found = []
    for name in names[1:]:
        rate = resolved(mesh, name)
        for prim in above:
            if prim.IsInstance() and (own(prim, name), own(prim, names[0])) != (None, None):
                rate = resolved(prim, name) or rate
        found.append(rate)
    return tuple(found)


@pytest.mark.parametrize("seed", range(40))
def test_any_nesting_of_instances(stage: Usd.Stage, seed: int) -> None:
    random = np.random.default_rng(seed)
    add_asset(stage, 2)
    stage.CreateClassPrim("/Group")
    UsdGeom.Xform.Define(stage, "/Group/Inside")
    for name in ("A", "Inside/B"):
        add_instance(stage, f"/Group/{name}")
    add_square(stage, "/Group/Inside/M")
    UsdGeom.Xform.Define(stage, "/World/Fine")
    for name in ("C", "D", "Fine/E", "Fine/F"):
        add_instance(stage, f"/World/{name}", "/Group" if random.random() < 0.6 else "/Asset")
    paths = ("/Asset/M0", "/Group/A", "/Group/Inside", "/Group/Inside/M", "/World", "/World/C", "/World/Fine")
    for path in (*paths, "/World/Fine/E", "/World/Fine/F"):
        for layer in ("", "direct", "refraction"):
            if random.random() < 0.2:
                say(stage.GetPrimAtPath(path), float(random.integers(0, 9)), layer)
    expected: dict[str, list[Any]] = {}
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Mesh):
            top = next(p for p in prim.GetPath().GetPrefixes() if stage.GetPrimAtPath(p).IsInstance())
            expected.setdefault(str(top), []).append(expected_rate(prim))
    translation = translate(stage)
    found: dict[str, list[Any]] = {top: [] for top in expected}
    for path, shown in rates(translation).items():
        found[next(top for top in expected if path == top or path.startswith(f"{top}/"))] += shown
    assert {top: sorted(r) for top, r in found.items()} == {top: sorted(r) for top, r in expected.items()}


# --- PointInstancers ---------------------------------------------------------------------------------


def new_instancer(stage: Usd.Stage, indices: list[int]) -> UsdGeom.PointInstancer:
    prototypes = []
    for i in range(max(indices) + 1):
        prototypes.append(f"/World/I/P{i}")
        add_square(stage, prototypes[-1])
    return add_point_instancer(stage, "/World/I", prototypes, indices)


@pytest.mark.parametrize("interpolation", ["uniform", "varying", "vertex"])
def test_one_rate_per_instance(stage: Usd.Stage, interpolation: str) -> None:
    instancer = new_instancer(stage, [0, 1, 0, 1])
    instancer.CreateIdsAttr([10, 11, 12, 13])
    instancer.CreateInvisibleIdsAttr([12])
    say_per_instance(instancer, [0.25, 1, 2, 8], interpolation)
    say_per_instance(instancer, [0, 3, 3, 0], interpolation, "refraction")
    translation = translate(stage)
    assert errors(translation) == []
    assert rates(translation) == {
        "/World/I[10]": [(0.25, 0.25, 0.25)],
        "/World/I[11]": [(1, 1, 3)],
        "/World/I[13]": [(8, 8, 8)],
    }


def test_one_rate_for_all_instances(stage: Usd.Stage) -> None:
    instancer = new_instancer(stage, [0, 0])
    say(instancer, 2)
    say_per_instance(instancer, [0, 5], "vertex", "direct")
    say(stage.GetPrimAtPath("/World/I/P0"), 100)
    assert rates(translate(stage)) == {"/World/I[0]": [(2, 2, 2)], "/World/I[1]": [(5, 2, 2)]}


def test_prototypes_inherit_where_they_are(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Prototypes/P")
    say(stage.GetPrimAtPath("/World/Prototypes"), 3)
    UsdGeom.Xform.Define(stage, "/World/Group")
    say(stage.GetPrimAtPath("/World/Group"), 9)
    add_point_instancer(stage, "/World/Group/I", ["/World/Prototypes/P"], [0])
    stage.GetPrimAtPath("/World/Prototypes").SetSpecifier(Sdf.SpecifierOver)
    assert rates(translate(stage)) == {"/World/Group/I[0]": [(3, 3, 3)]}


def test_indexed_rates(stage: Usd.Stage) -> None:
    instancer = new_instancer(stage, [0, 0, 0])
    primvar = say_per_instance(instancer, [4, 1], "vertex")
    primvar.SetIndices([1, 0, 1])
    assert list(rates(translate(stage)).values()) == [[(1, 1, 1)], [(4, 4, 4)], [(1, 1, 1)]]


@pytest.mark.parametrize(
    ("values", "interpolation", "message"),
    [
        ([1, 2], "vertex", "2 values for 3 instances"),
        ([1, 2, 3, 4], "uniform", "4 values for 3 instances"),
        ([1, -2, 3], "vertex", "-2 is not a number from 0 to 256"),
        ([1, 2, float("nan")], "varying", "nan is not a number from 0 to 256"),
        ([1, 2, 3], "faceVarying", "faceVarying interpolation on a PointInstancer"),
        ([1, 2, 3], "constant", "3 values where one is needed"),
    ],
)
def test_bad_rates_of_a_point_instancer(
    stage: Usd.Stage, values: list[float], interpolation: str, message: str
) -> None:
    instancer = new_instancer(stage, [0, 0, 0])
    say_per_instance(instancer, values, interpolation, "direct")
    say(instancer, 2, "refraction")
    translation = translate(stage)
    (line,) = errors(translation)
    assert line.startswith(f"Error: /World/I: primvar {RATE}:direct is ignored: it")
    assert message in line
    assert set(map(tuple, rates(translation).values())) == {((0, 0, 2),)}


def test_bad_indices_of_a_point_instancer(stage: Usd.Stage) -> None:
    instancer = new_instancer(stage, [0, 0])
    say_per_instance(instancer, [4, 1], "vertex").SetIndices([0, 7])
    translation = translate(stage)
    (line,) = errors(translation)
    assert "its indices do not fit its values" in line
    assert set(map(tuple, rates(translation).values())) == {(NO_RATE,)}


def test_point_instancers_in_native_instances(stage: Usd.Stage) -> None:
    """The rates of the instance that is walked for all of them do not stay with its prototypes."""
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/I/P")
    add_point_instancer(stage, "/Asset/I", ["/Asset/I/P"], [0, 0])
    say(stage.GetPrimAtPath("/World"), 7, "refraction")
    for name, rate in (("A", 1.0), ("B", 2.0), ("C", None)):
        prim = add_instance(stage, f"/World/{name}")
        if rate:
            say(prim, rate)
    translation = translate(stage)
    assert translation.counts["meshes"] == 1
    found = rates(translation)
    assert [found[f"/World/{name}/I[{i}]"] for name in "ABC" for i in (0, 1)] == [
        [(1, 1, 7)], [(1, 1, 7)], [(2, 2, 7)], [(2, 2, 7)], [(0, 0, 7)], [(0, 0, 7)],
    ]  # fmt: skip


def test_point_instancers_in_point_instancers(stage: Usd.Stage) -> None:
    inner = add_point_instancer(stage, "/World/Outer/Inner", ["/World/Outer/Inner/P"], [0, 0])
    add_square(stage, "/World/Outer/Inner/P")
    outer = add_point_instancer(stage, "/World/Outer", ["/World/Outer/Inner"], [0, 0])
    say_per_instance(inner, [3, 4], "vertex")
    say_per_instance(outer, [0, 1], "vertex", "reflection")
    found = sorted(rate for (rate,) in rates(translate(stage)).values())
    assert found == [(3, 1, 3), (3, 3, 3), (4, 1, 4), (4, 4, 4)]


# --- Elsewhere ---------------------------------------------------------------------------------------


def test_combine() -> None:
    outer = np.array([[1, 0, 0], [0, 2, 0]], np.float32)
    inner = np.array([[5, 6, 7]], np.float32)
    assert combine(None, None, 2, 1) is None
    assert combine(outer, None, 2, 2).tolist() == [[1, 0, 0], [1, 0, 0], [0, 2, 0], [0, 2, 0]]
    assert combine(None, inner, 2, 1).tolist() == [[5, 6, 7], [5, 6, 7]]
    assert combine(outer, inner, 2, 1).tolist() == [[1, 6, 7], [5, 2, 7]]


def test_dump_shows_rates(stage: Usd.Stage) -> None:
    instancer = new_instancer(stage, [0, 0])
    say(stage.GetPrimAtPath("/World/I/P0"), 2, "direct")
    say_per_instance(instancer, [0, 0.5], "vertex")
    text = dump(translate(stage))
    assert "mesh /World/I/P0\n" in text
    assert "  shading_rate: (2, 0, 0)\n" in text
    assert text.count("  shading_rate: (0.5, 0.5, 0.5)\n") == 1
