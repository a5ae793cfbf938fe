"""The table of settings against the core, the documentation, and bad values."""

import re
from pathlib import Path
from typing import Any

import pytest
from encore.errors import OutputError, SettingError, UsageError
from encore.settings import GROUPS, SETTINGS, Setting, parse_size, resolve, shader_cache_folder

DOCS = Path(__file__).parents[2] / "docs"
NUMERIC = [s for s in SETTINGS.values() if s.kind in ("int", "float", "size")]


def test_keys_and_defaults_are_those_of_the_core() -> None:
    core = pytest.importorskip("encore._core").default_settings()
    assert set(core) == set(SETTINGS)
    for key, setting in SETTINGS.items():
        if setting.default is not None:
            expected = (
                setting.default
                if isinstance(setting.default, str)
                else pytest.approx(setting.default, rel=1e-6)
            )
            assert core[key] == expected, key


def core_refuses(key: str, value: Any, **others: Any) -> bool:
    """Whether the core calls the value out of range; it checks settings before it looks at the scene."""
    core = pytest.importorskip("encore._core")
    with pytest.raises(core.Error) as caught:
        core.render(core.Scene(), {key: value, **others})
    return caught.value.kind == "setting" and caught.value.where == key


@pytest.mark.parametrize("setting", [s for s in NUMERIC if s.kind != "size"], ids=lambda s: s.key)
def test_ranges_are_those_of_the_core(setting: Setting) -> None:
    for bound, outwards in ((setting.minimum, -1), (setting.above, 0), (setting.maximum, 1)):
        if bound is None:
            continue
        # Far enough for the core's single precision.
        step = setting.multiple_of or (1 if setting.kind == "int" else max(1e-3, 1e-3 * abs(bound)))
        outside = bound + outwards * step
        with pytest.raises(SettingError, match=setting.flag):
            setting.check(outside)
        if not (setting.kind == "int" and (outside < 0 or outside > 2**32 - 1)):  # no such number in the core
            assert core_refuses(setting.key, outside)
        inside = bound + step if bound == setting.above else bound
        setting.check(inside)
        assert not core_refuses(setting.key, inside)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite_are_out_of_range(value: float) -> None:
    for setting in NUMERIC:
        with pytest.raises(SettingError):
            setting.check(value)


def test_names_of_choices_are_those_of_the_core() -> None:
    for key in (s.key for s in SETTINGS.values() if s.kind == "choice"):
        for choice in SETTINGS[key].choices:
            assert not core_refuses(key, choice)
        assert core_refuses(key, "no such thing")


def test_tiles_must_be_whole_blocks() -> None:
    with pytest.raises(SettingError, match="multiple of 16"):
        resolve({"reuse_tile_pixels": 100})


def test_the_shader_cache_is_where_the_system_has_caches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert shader_cache_folder("") == str(tmp_path / "xdg" / "encore")
    assert (tmp_path / "xdg" / "encore").is_dir()
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert shader_cache_folder("") == str(tmp_path / "home" / ".cache" / "encore")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/is/ignored")
    assert shader_cache_folder("") == str(tmp_path / "home" / ".cache" / "encore")


def test_shader_caches_that_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert shader_cache_folder("none") == ""
    assert shader_cache_folder(str(tmp_path / "a" / "b")) == str(tmp_path / "a" / "b")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be used as a shader cache"):
        shader_cache_folder(str(tmp_path / "file" / "below"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert shader_cache_folder("") == "", "without one that can be made there is none"


@pytest.mark.parametrize("key", ["reuse_time_weight", "reuse_direction_weight"])
def test_searches_that_do_not_know_time_and_direction(key: str) -> None:
    resolve({"search": "tree", key: 1.0})
    with pytest.raises(SettingError, match=SETTINGS[key].flag):
        resolve({"search": "groups", key: 1.0})
    assert core_refuses("search", "groups", **{key: 1.0})


def test_resolve_puts_given_values_over_defaults() -> None:
    settings = resolve({"samples": 3, "seed": None})
    assert settings["samples"] == 3
    assert settings["seed"] == 0
    assert settings["height"] is None
    assert set(settings) == set(SETTINGS)


@pytest.mark.parametrize("search", ["groups", "cells"])
def test_searches_that_do_not_know_the_metric_are_refused_with_it(search: str) -> None:
    resolve({"search": search, "footprint_reuse": "octaves"})
    for able in ("auto", "tree"):
        resolve({"search": able, "footprint_reuse": "metric"})
    with pytest.raises(SettingError, match=r"--search: .*--footprintReuse metric.* auto or tree"):
        resolve({"search": search, "footprint_reuse": "metric"})
    core = pytest.importorskip("encore._core")
    with pytest.raises(core.Error) as caught:
        core.render(core.Scene(), {"search": search, "footprint_reuse": "metric"})
    assert (caught.value.kind, caught.value.where) == ("setting", "search")


def test_an_unknown_choice_names_all_that_there_are() -> None:
    for setting in (s for s in SETTINGS.values() if s.kind == "choice"):
        with pytest.raises(UsageError, match=f"{setting.flag}.*{', '.join(setting.choices)}"):
            resolve({setting.key: "sinc"})


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("0", 0),
        ("1000000", 1_000_000),
        ("64M", 64 * 2**20),
        ("64m", 64 * 2**20),
        ("1G", 2**30),
        ("1.5GiB", 3 * 2**29),
        ("512MiB", 512 * 2**20),
        ("512MB", 512_000_000),
        ("2 TB", 2 * 10**12),
        ("7B", 7),
    ],
)
def test_sizes(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "G", "-1G", "1X", "1GiBs", "1e9", "0x10", "nan"])
def test_what_is_no_size(text: str) -> None:
    with pytest.raises(UsageError, match="--memory"):
        SETTINGS["memory_budget_bytes"].parse(text)


def test_documentation_lists_every_setting_as_it_is() -> None:
    text = (DOCS / "settings.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(--\w+)[^|]*(\|.*)$", text, re.M))
    assert set(rows) == {s.flag for s in SETTINGS.values()}
    for setting in SETTINGS.values():
        cells = [cell.strip() for cell in rows[setting.flag].strip("|").split("|")]
        assert cells == [
            f"`{setting.key}`",
            setting.default_text,
            setting.unit or "–",
            setting.range_text,
            setting.doc,
        ]


def test_every_group_has_settings_and_flags_are_unique() -> None:
    flags = [flag for group in GROUPS.values() for setting in group for flag in setting.flags]
    assert all(GROUPS.values())
    assert len(flags) == len(set(flags))
