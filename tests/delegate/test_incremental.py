"""A sync after edits comes to the scene that a new RenderIndex comes to, and reads no more than it must."""

from __future__ import annotations

import os
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edited_stage import EDITS, make_stage
from encore.dump import dump
from encore.errors import StageError
from encore.render_index import RenderIndex, SyncCounts, SyncOptions
from pxr import Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade
from stages import add_square, connect_texture, square_with, surface, write_image

OPTIONS = SyncOptions(camera="", time=Usd.TimeCode(1))


@pytest.fixture
def edited(tmp_path: Path) -> Usd.Stage:
    return make_stage(tmp_path)


def text(index: RenderIndex, time: Usd.TimeCode | None = None) -> str:
    """The scene as text, or why there is none."""
    try:
        return dump(index.sync(time))
    except StageError as error:
        return f"nothing: {error.what}; {error.remedy}"


def check(index: RenderIndex, what: str, time: Usd.TimeCode | None = None) -> None:
    fresh = RenderIndex(index.stage, index.options)
    expected, found = text(fresh, time).splitlines(), text(index, time).splitlines()
    different = [f"{e!r} became {f!r}" for e, f in zip(expected, found, strict=False) if e != f]
    assert found == expected, f"after {what}: {different[:3]}, {len(expected)} lines, {len(found)} found"


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_and_its_repetition(edited: Usd.Stage, name: str) -> None:
    index = RenderIndex(edited, OPTIONS)
    check(index, "nothing")
    for seed in range(2):
        EDITS[name](edited, random.Random(seed))
        check(index, f"{name}, {seed}")


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_does_something(edited: Usd.Stage, name: str) -> None:
    """Otherwise there would be nothing to find in the test above."""
    if name in (
        "words",
        "collection",
        "restored material",
        "a node's value",
        "removed prim",
        "no session layer",
        "up axis",
        "time codes per second",
    ):
        pytest.skip("in need of other edits")
    before = text(RenderIndex(edited, OPTIONS), Usd.TimeCode(2))
    for seed in range(6):
        EDITS[name](edited, random.Random(seed))
        if text(RenderIndex(edited, OPTIONS), Usd.TimeCode(2)) != before:
            return
    pytest.fail("it does nothing")


@pytest.mark.parametrize("seed", range(6))
def test_edits_in_any_order(edited: Usd.Stage, seed: int) -> None:
    random_ = random.Random(seed)
    index = RenderIndex(edited, OPTIONS)
    done = []
    for _ in range(12):
        for name in random_.sample(sorted(EDITS), random_.choice((1, 1, 2, 4))):
            try:
                EDITS[name](edited, random_)
            except (Tf.ErrorException, RuntimeError):
                continue  # what another edit has taken away
            done.append(name)
        time = Usd.TimeCode(random_.choice((1, 1, 1, 2, 3.5)))
        check(index, f"{done[-8:]} at {time}", time)


def test_times(edited: Usd.Stage) -> None:
    index = RenderIndex(edited, OPTIONS)
    for frame in (1, 2, 3, 4.5, 2, 1, 1):
        check(index, f"frame {frame}", Usd.TimeCode(frame))
    check(index, "the default time", Usd.TimeCode.Default())
    check(index, "a time again", Usd.TimeCode(3))


@pytest.mark.parametrize(
    "changes",
    [
        {"purposes": ("default", "guide")},
        {"camera": "/World/Group"},
        {"depth_of_field": False},
        {"width": 320, "height": 100},
        {"camera_light": False},
        {"material_purposes": ("preview", "full")},
        {"aov_primvars": (("tint", 3),)},
        {"aov_primvars": (("displayColor", 3),)},
        {"strict": True},
    ],
)
def test_options_may_change(edited: Usd.Stage, changes: dict[str, Any]) -> None:
    index = RenderIndex(edited, OPTIONS)
    check(index, "nothing")
    index.options = replace(OPTIONS, **changes)
    check(index, str(changes))
    index.options = OPTIONS
    check(index, "back")


# What is read


def counts(index: RenderIndex, time: Usd.TimeCode | None = None) -> SyncCounts:
    index.sync(time)
    return index.last_sync


NOTHING = SyncCounts()


def test_nothing_is_read_twice(edited: Usd.Stage) -> None:
    index = RenderIndex(edited, OPTIONS)
    first = counts(index)
    assert first.prims_walked > 20 and first.rprims_read > 10 and first.materials_read == 4
    assert first.lights_read == 3 and first.bindings_resolved > 10
    assert counts(index) == NOTHING
    EDITS["words"](edited, random.Random(0))
    assert counts(index) == NOTHING


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a material", SyncCounts(materials_read=1)),
        ("points", SyncCounts(rprims_read=1)),
        ("light", SyncCounts(lights_read=1)),
        ("camera", SyncCounts(prims_walked=1)),
        ("transform", SyncCounts(prims_walked=2)),  # with its subset
        ("transform of an instance", SyncCounts(prims_walked=1)),
        ("positions", SyncCounts(prims_walked=1)),
        ("prototype of an instancer", SyncCounts(rprims_read=1)),
        ("content of a prototype", SyncCounts(rprims_read=2)),  # and the one that is loaded
    ],
)
def test_only_what_changed_is_read(edited: Usd.Stage, name: str, expected: SyncCounts) -> None:
    random_ = random.Random(1)
    EDITS[name](edited, random_)  # properties are there from now on
    index = RenderIndex(edited, OPTIONS)
    index.sync()
    EDITS[name](edited, random_)
    assert counts(index) == expected


def test_a_material_that_reads_more_has_its_meshes_read(edited: Usd.Stage) -> None:
    index = RenderIndex(edited, OPTIONS)
    index.sync()
    shader = surface(UsdShade.Material.Get(edited, "/World/Looks/Red"))
    reader = UsdShade.Shader.Define(edited, "/World/Looks/Red/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    shader.GetInput("diffuseColor").ConnectToSource(reader.ConnectableAPI(), "result")
    found = counts(index)
    assert found.materials_read == 1 and found.rprims_read == 2, "the strip and what is collected"
    check(index, "a reader")


def test_only_what_varies_is_read_at_another_time(edited: Usd.Stage) -> None:
    index = RenderIndex(edited, OPTIONS)
    index.sync()
    found = counts(index, Usd.TimeCode(2))
    assert found.rprims_read == 1, "what bends"
    assert found.prims_walked == 2, "what moves, and what blinks"
    assert found.materials_read == found.lights_read == found.bindings_resolved == 0


def test_meshes_that_stay_are_the_same_for_core(edited: Usd.Stage) -> None:
    """Their arrays are shared between scenes, so that what was made of them can be used again."""
    index = RenderIndex(edited, OPTIONS)
    index.sync()
    entries = index._parts.rprims.entries
    before = {key: [m.handle for m in e.meshes.values()] for key, e in entries.items()}
    EDITS["a material"](edited, random.Random(0))
    EDITS["transform of a group"](edited, random.Random(0))
    EDITS["points"](edited, random.Random(0))
    index.sync()
    changed = [
        key[0]
        for key, entry in index._parts.rprims.entries.items()
        if [id(m.handle) for m in entry.meshes.values()] != [id(h) for h in before[key]]
    ]
    assert changed == [Sdf.Path("/World/Group/Plain")]


def test_textures_are_read_again_when_their_file_changes(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    file = tmp_path / "a.png"
    connect_texture(stage, surface(material), write_image(file))
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh")).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex"
    ).Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    index = RenderIndex(stage)
    index.sync()
    assert counts(index) == NOTHING
    write_image(file, np.ones((3, 5, 3)))
    os.utime(file, (1, 1))
    assert counts(index) == SyncCounts(materials_read=1)
    check(index, "a new file")
    file.unlink()
    check(index, "no file")
    write_image(file)
    check(index, "a file again")


def test_hidden_prims_are_not_read(stage: Usd.Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor those of other purposes: neither points nor anything else."""
    add_square(stage, "/World/Shown")
    add_square(stage, "/World/Group/Hidden")
    UsdGeom.Xform.Define(stage, "/World/Group").CreateVisibilityAttr("invisible")
    add_square(stage, "/World/Guide").CreatePurposeAttr("guide")
    asked: list[str] = []
    get = Usd.Attribute.Get

    def probe(attribute: Usd.Attribute, *arguments: Any) -> Any:
        asked.append(str(attribute.GetPath()))
        return get(attribute, *arguments)

    monkeypatch.setattr(Usd.Attribute, "Get", probe)
    RenderIndex(stage, SyncOptions(camera_light=False)).sync()
    assert "/World/Shown.points" in asked and "/World/Group.visibility" in asked
    assert not [path for path in asked if path.startswith(("/World/Group/Hidden", "/World/Guide.points"))]


def test_arrays_are_not_copied_in_python(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    mesh.CreateDisplayColorPrimvar("vertex").Set([(1, 0, 0)] * 4)
    index = RenderIndex(stage)
    index.sync()
    ((entry),) = index._parts.rprims.entries.values()
    data = entry.geometry.data
    for array in (data.points, data.face_vertex_counts, data.face_vertex_indices, data.display_color.values):
        assert not array.flags.owndata and not array.flags.writeable, "a view of USD's own"


def test_an_error_in_the_middle_leaves_nothing_half_known(
    edited: Usd.Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = RenderIndex(edited, OPTIONS)
    index.sync()
    EDITS["points"](edited, random.Random(0))
    with monkeypatch.context() as patch:
        patch.setattr("encore.rprims.reader_of", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            index.sync()
    check(index, "an error")


def test_a_stage_that_becomes_empty_and_back(edited: Usd.Stage) -> None:
    index = RenderIndex(edited, OPTIONS)
    check(index, "nothing")
    world = UsdGeom.Imageable(edited.GetPrimAtPath("/World"))
    world.MakeInvisible()
    check(index, "invisible")
    world.MakeVisible()
    check(index, "visible")
    edited.GetPrimAtPath("/World").SetActive(False)
    check(index, "inactive")
    edited.GetPrimAtPath("/World").SetActive(True)
    check(index, "active")


def test_lights_alone_may_be_all_that_changes(edited: Usd.Stage) -> None:
    index = RenderIndex(edited, OPTIONS)
    index.sync()
    UsdLux.DomeLight.Define(edited, "/World/Dome")
    found = counts(index)
    assert found.lights_read == 1 and found.rprims_read == 0
    check(index, "a dome")


def test_what_is_known_of_groups_that_are_gone_is_forgotten(edited: Usd.Stage) -> None:
    """Values that instances inherit tell their prototypes apart: over many frames there would be many."""
    group = UsdGeom.PrimvarsAPI(edited.GetPrimAtPath("/World/Assets"))
    rate = group.CreatePrimvar("encore:targetEdgeLength", Sdf.ValueTypeNames.Float, "constant")
    for frame in range(10):
        rate.Set(1.0 + frame, frame)
    index = RenderIndex(edited, OPTIONS)
    sizes = []
    for frame in range(10):
        check(index, f"frame {frame}", Usd.TimeCode(frame))
        sizes.append(len(index._parts.rprims.entries))
    assert max(sizes[4:]) == min(sizes[4:])
