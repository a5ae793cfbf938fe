"""Light and shadow linking: groups of prims that the same lights light."""

from typing import Any

import pytest
from encore.adapters import linking
from encore.render_index import Translation
from pxr import Sdf, Usd, UsdLux
from stages import (
    add_instance,
    add_point_instancer,
    add_square,
    instances,
    kinds,
    lights,
    new_stage,
    translate,
)


@pytest.fixture
def stage() -> Usd.Stage:
    stage = new_stage()
    for path in ("/World/A", "/World/B", "/World/Set/C", "/World/Set/D"):
        add_square(stage, path)
    for name in ("Key", "Fill"):
        UsdLux.RectLight.Define(stage, f"/World/{name}")
    return stage


def collection(stage: Usd.Stage, light: str, link: str = "lightLink") -> Usd.CollectionAPI:
    return Usd.CollectionAPI(stage.GetPrimAtPath(f"/World/{light}"), link)


def include(found: Usd.CollectionAPI, *paths: str) -> None:
    found.CreateIncludeRootAttr(False)
    found.CreateIncludesRel().SetTargets(list(paths))


def linked(translation: Translation, light: str, link: str = "lit_groups") -> set[str]:
    """Paths of the instances that a light lights, or that shadow it."""
    groups = lights(translation)[f"/World/{light}"][link]
    placed = instances(translation)
    return {p for p, i in placed.items() if not groups or groups[i["link_group"]]}


ALL = {"/World/A", "/World/B", "/World/Set/C", "/World/Set/D"}


def test_lights_that_leave_nothing_out_make_no_groups(stage: Usd.Stage, monkeypatch: Any) -> None:
    found = collection(stage, "Key")
    found.CreateIncludeRootAttr(True)
    found.CreateIncludesRel().SetTargets(["/World/A"])
    monkeypatch.setattr(Usd.CollectionAPI, "ComputeMembershipQuery", None)
    translation = translate(stage)
    assert {i["link_group"] for i in instances(translation).values()} == {-1}
    for light in lights(translation).values():
        assert not light["lit_groups"] and not light["shadow_groups"]


def test_excludes(stage: Usd.Stage) -> None:
    collection(stage, "Key").CreateExcludesRel().SetTargets(["/World/Set", "/World/A"])
    translation = translate(stage)
    assert linked(translation, "Key") == {"/World/B"}
    assert linked(translation, "Fill") == ALL
    assert linked(translation, "Key", "shadow_groups") == ALL
    assert not lights(translation)["/World/Fill"]["lit_groups"]


def test_includes_below_excludes(stage: Usd.Stage) -> None:
    found = collection(stage, "Key")
    include(found, "/World/A", "/World/Set")
    found.CreateExcludesRel().SetTargets(["/World/Set/D"])
    assert linked(translate(stage), "Key") == {"/World/A", "/World/Set/C"}


def test_shadows_apart_from_light(stage: Usd.Stage) -> None:
    include(collection(stage, "Key", "shadowLink"), "/World/B")
    include(collection(stage, "Key"), "/World/A", "/World/B")
    include(collection(stage, "Fill"), "/World/Set/C")
    translation = translate(stage)
    assert linked(translation, "Key", "shadow_groups") == {"/World/B"}
    assert linked(translation, "Key") == {"/World/A", "/World/B"}
    assert linked(translation, "Fill") == {"/World/Set/C"}
    groups = {p: i["link_group"] for p, i in instances(translation).items()}
    assert len(set(groups.values())) == 4 == len(lights(translation)["/World/Key"]["lit_groups"])


def test_only_distinct_memberships_make_groups(stage: Usd.Stage) -> None:
    include(collection(stage, "Key"), "/World/Set")
    translation = translate(stage)
    groups = {p: i["link_group"] for p, i in instances(translation).items()}
    assert groups["/World/A"] == groups["/World/B"] != groups["/World/Set/C"] == groups["/World/Set/D"]
    assert sorted(set(groups.values())) == [0, 1]


def test_expansion_rules(stage: Usd.Stage) -> None:
    found = collection(stage, "Key")
    include(found, "/World/Set", "/World/A")
    found.CreateExpansionRuleAttr(Usd.Tokens.explicitOnly)
    assert linked(translate(stage), "Key") == {"/World/A"}


def test_an_expression(stage: Usd.Stage) -> None:
    found = collection(stage, "Key")
    found.CreateIncludeRootAttr(False)
    found.CreateMembershipExpressionAttr(Sdf.PathExpression("/World/Set//"))
    assert linked(translate(stage), "Key") == {"/World/Set/C", "/World/Set/D"}


def test_a_collection_of_a_collection(stage: Usd.Stage) -> None:
    heroes = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/World"), "heroes")
    heroes.IncludePath("/World/Set/D")
    include(collection(stage, "Key"), str(heroes.GetCollectionPath()))
    assert linked(translate(stage), "Key") == {"/World/Set/D"}


def test_a_light_that_lights_nothing(stage: Usd.Stage) -> None:
    collection(stage, "Key").CreateIncludeRootAttr(False)
    assert linked(translate(stage), "Key") == set()


def test_native_instances_by_their_own_paths(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Mesh")
    UsdLux.SphereLight.Define(stage, "/Asset/Lamp")
    for name in ("I", "J"):
        add_instance(stage, f"/World/{name}")
    include(collection(stage, "Key"), "/World/I")
    translation = translate(stage)
    assert linked(translation, "Key") == {"/World/I"}
    assert translation.counts["meshes"] == 5, "the prototype is shared all the same"
    assert linked(translation, "I/Lamp") == {*ALL, "/World/I", "/World/J"}
    assert "linking inside an instance" not in kinds(translation)
    include(collection(stage, "Key"), "/World/J/Mesh")
    assert kinds(translate(stage))["linking inside an instance"] == 1


def test_lights_of_instances_may_be_linked_to_what_is_in_their_asset(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Mesh")
    lamp = UsdLux.SphereLight.Define(stage, "/Asset/Lamp").GetPrim()
    include(Usd.CollectionAPI(lamp, "lightLink"), "/Asset")
    for name in ("I", "J"):
        add_instance(stage, f"/World/{name}")
    translation = translate(stage)
    assert linked(translation, "I/Lamp") == {"/World/I"}
    assert linked(translation, "J/Lamp") == {"/World/J"}


def test_point_instancers_by_their_own_paths(stage: Usd.Stage) -> None:
    add_square(stage, "/World/PI/Proto")
    add_point_instancer(stage, "/World/PI", ["/World/PI/Proto"], [0, 0])
    include(collection(stage, "Key"), "/World/PI")
    assert linked(translate(stage), "Key") == {"/World/PI[0]", "/World/PI[1]"}


def test_what_is_not_restricted_is_not_queried(stage: Usd.Stage) -> None:
    add_square(stage, "/World/E")
    links = linking.Links(
        [stage.GetPrimAtPath("/World/Key")],
        None,  # type: ignore[arg-type]
    )
    assert not links and links.group("/World/E") == -1
