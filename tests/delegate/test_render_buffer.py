"""Render buffers: format, orientation, what is visible when, and the AOVs that are rendered into them."""

from typing import Any

import numpy as np
import pytest
from encore import aov
from encore.errors import MemoryLimitError, UsageError
from encore.render_buffer import AovBinding, Format, RenderBuffer, pixel_window
from pxr import Gf


def test_format_decides_type_and_shape() -> None:
    buffer = RenderBuffer()
    for format, dtype, shape in [
        (Format.FLOAT32, np.float32, (2, 5)),
        (Format.FLOAT32_VEC2, np.float32, (2, 5, 2)),
        (Format.FLOAT32_VEC3, np.float32, (2, 5, 3)),
        (Format.FLOAT32_VEC4, np.float32, (2, 5, 4)),
        (Format.INT32, np.int32, (2, 5)),
    ]:
        buffer.allocate(5, 2, format, clear_value=-1)
        assert (buffer.width, buffer.height, buffer.format, buffer.dtype) == (5, 2, format, dtype)
        with buffer.mapped() as pixels:
            assert pixels.shape == shape
            assert pixels.dtype == dtype
            assert (pixels == -1).all()


def test_clear_value_may_have_components() -> None:
    buffer = RenderBuffer()
    buffer.allocate(2, 2, Format.FLOAT32_VEC4, (0.1, 0.2, 0.3, 1))
    assert buffer.map()[1, 1] == pytest.approx((0.1, 0.2, 0.3, 1))


def test_sizes_that_no_memory_has() -> None:
    buffer = RenderBuffer("/Buffer")
    for size in (2**22, 2**32):
        with pytest.raises(MemoryLimitError, match=r"^/Buffer: .*memory"):
            buffer.allocate(2**32, size)


def test_windows() -> None:
    found = pixel_window(np.array([-1, 2, 3, 4]))
    assert found == (-1, 2, 3, 4)
    assert all(type(edge) is int for edge in found)
    for wrong in ((0, 0, 3), "abc", "abcd", (0.0, 0.0, 1.0, 1.0), 7, (0, 0, 1, None), (0, 0, 1, 1, 1)):
        with pytest.raises(UsageError, match=r"^window: .*no rectangle"):
            pixel_window(wrong)
    for empty in ((2, 0, 2, 1), (0, 3, 1, 2), (0, 0, 2**31, 1), (-(2**40), 0, 0, 1)):
        with pytest.raises(UsageError, match=r"^window: .*no pixels"):
            pixel_window(empty)


def test_rectangles_land_where_they_belong_the_top_row_first() -> None:
    buffer = RenderBuffer()
    buffer.allocate(4, 3, Format.FLOAT32)
    buffer.add(1, 0, np.array([[1, 2]], np.float32))
    buffer.add(0, 2, np.array([[3]], np.float32))
    with buffer.mapped() as pixels:
        assert pixels.tolist() == [[0, 1, 2, 0], [0, 0, 0, 0], [3, 0, 0, 0]]
    assert buffer.finished_rectangles == ((1, 0, 3, 1), (0, 2, 1, 3))


def test_what_is_mapped_is_read_only_and_does_not_change() -> None:
    buffer = RenderBuffer("/Buffer")
    buffer.allocate(2, 1, Format.FLOAT32)
    pixels = buffer.map()
    assert buffer.is_mapped
    with pytest.raises(ValueError, match="read-only"):
        pixels[0, 0] = 1
    buffer.add(0, 0, np.ones((1, 2), np.float32))
    buffer.resolve()
    buffer.set_converged()
    assert pixels.tolist() == [[0, 0]]
    assert buffer.finished_rectangles == ()
    with pytest.raises(UsageError, match=r"^/Buffer: .*mapped"):
        buffer.allocate(3, 3)
    buffer.unmap()
    assert not buffer.is_mapped
    with buffer.mapped() as after:
        assert after.tolist() == [[1, 1]]
    with pytest.raises(UsageError, match="not mapped"):
        buffer.unmap()


def test_nothing_is_visible_before_it_is_resolved() -> None:
    buffer = RenderBuffer()
    buffer.allocate(1, 1, Format.INT32, -1)
    buffer.add(0, 0, np.array([[7]]))
    assert buffer.finished_rectangles == ()
    buffer.resolve()
    assert buffer.finished_rectangles == ((0, 0, 1, 1),)
    assert not buffer.is_converged
    buffer.set_converged()
    assert buffer.is_converged
    assert buffer.map().tolist() == [[7]]


def test_arrays_outlive_the_next_allocation() -> None:
    buffer = RenderBuffer()
    buffer.allocate(1, 1, Format.FLOAT32, 5)
    with buffer.mapped() as pixels:
        kept = pixels
    buffer.allocate(1, 1, Format.FLOAT32, 6)
    assert kept.tolist() == [[5]]
    assert not buffer.is_converged


def binding(name: str, **settings: object) -> AovBinding:
    return AovBinding(name, RenderBuffer(), settings=settings)


def test_what_core_is_asked_for() -> None:
    asked = [binding("color"), binding("P"), binding("primId"), binding("primvars:st", components=2)]
    assert aov.requests(asked) == [
        {"kind": "position", "name": "P"},
        {"kind": "primId", "name": "primId"},
        {"kind": "primvar", "name": "primvars:st", "primvar": "st", "components": 2},
    ]
    assert aov.descriptor(asked[-1]).format is Format.FLOAT32_VEC2
    assert aov.descriptor(binding("primvars:st")).format is Format.FLOAT32_VEC3
    assert aov.descriptor(AovBinding("primId", RenderBuffer(), clear_value=9)).clear_value == 9


def test_wrong_requests() -> None:
    for name in ("colour", "primvars:", ""):
        with pytest.raises(UsageError, match="no such AOV"):
            aov.default_descriptor(name)
    with pytest.raises(UsageError, match="twice"):
        aov.requests([binding("P"), binding("P")])
    for name, settings in [
        *(("primvars:st", {"components": count}) for count in (0, 5, 2.0, True, "2", None, [2])),
        ("P", {"components": 2}),
        ("primvars:st", {"component": 2}),
        ("color", {"foo": 2}),
        ("color", None),
    ]:
        wrong: Any = settings
        with pytest.raises(UsageError, match=f"^aovs: '{name}': .*cannot be had"):
            aov.descriptor(AovBinding(name, RenderBuffer(), settings=wrong))
    number: Any = 5
    with pytest.raises(UsageError, match="no such AOV"):
        aov.default_descriptor(number)


def test_clear_values_that_no_pixel_can_be() -> None:
    for name, value in [
        ("color", (1, 2)),
        ("color", "blue"),
        ("color", [[1, 2, 3, 4]]),
        ("depth", (1, 2)),
        ("primId", float("nan")),
        ("primId", 2**40),
    ]:
        with pytest.raises(UsageError, match=f"^aovs: '{name}': clear value .*Give a number"):
            aov.descriptor(AovBinding(name, RenderBuffer(), clear_value=value))
    for name, fits in (("color", 0.5), ("color", (1, 2, 3, 4)), ("normal", Gf.Vec3f(1)), ("depth", 1)):
        assert aov.descriptor(AovBinding(name, RenderBuffer(), clear_value=fits)).clear_value == fits


def test_every_aov_has_its_own_buffer() -> None:
    shared = RenderBuffer()
    with pytest.raises(UsageError, match=r"^aovs: 'depth': 'color' has the same buffer"):
        aov.requests([AovBinding("color", shared), binding("P"), AovBinding("depth", shared)])


def test_a_layer_that_the_scene_cannot_feed_is_black() -> None:
    direct = np.ones((2, 3, 3), np.float32)
    images = {"layers": {"direct": direct}, "composite": direct, "alpha": np.full((2, 3), 0.5, np.float32)}
    assert aov.pixels("direct", images) is direct
    assert aov.pixels("reflection", images).shape == (2, 3, 3)
    assert not aov.pixels("reflection", images).any()
    assert aov.pixels("color", images)[1, 2].tolist() == [1, 1, 1, 0.5]
