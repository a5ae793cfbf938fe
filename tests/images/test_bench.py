"""Statistics that the bench reports."""

from __future__ import annotations

import numpy as np
import pytest
from bench import ALONE, DEFAULT_SCENES, PARTS, PRINTERS, parse
from bench_measure import BLOCK, block_means, mean_difference, t_quantile
from bench_parts import equal_error, equal_rays


@pytest.mark.parametrize(
    ("probability", "freedom", "value"),
    [(0.975, 5, 2.5706), (0.995, 15, 2.9467), (0.975, 30, 2.0423), (0.5, 9, 0.0), (0.995, 1e6, 2.5758)],
)
def test_quantiles_of_students_t(probability: float, freedom: float, value: float) -> None:
    assert abs(t_quantile(probability, freedom) - value) < 3e-3


def test_means_over_blocks_leave_incomplete_ones_out() -> None:
    image = np.zeros((BLOCK * 2 + 3, BLOCK + 5, 3))
    image[BLOCK : 2 * BLOCK, :BLOCK] = 2
    image[2 * BLOCK :] = 100
    np.testing.assert_array_equal(block_means(image), [0, 2])


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    random = np.random.default_rng(5)
    a, b = random.normal(1.0, 0.3, (16, 4000)), random.normal(1.0, 0.1, (8, 4000))
    mean, error, freedom = mean_difference(a, b)
    limit = np.array([t_quantile(0.995, f) for f in freedom])
    outside = (np.abs(mean) > limit * error).mean()
    assert 0.004 < outside < 0.018


def test_equal_rays_are_at_least_one() -> None:
    reuse, reference = {"shading_evaluations": 300}, {"shading_evaluations": 12000}
    assert equal_rays(reuse, reference) == {"light_samples": 1, "occlusion_samples": 2}


def test_equal_error_is_read_off_the_curve() -> None:
    curve = [{"seconds": t, "rmse": 0.1 * t**-0.5} for t in (1.0, 4.0, 16.0)]
    row = equal_error({"seconds": 2.0, "rmse": 0.1 / 3}, curve, "rmse")
    assert abs(row["distribution_seconds"] - 9) < 1e-6
    assert row["within_the_curve"]
    assert not equal_error({"seconds": 2.0, "rmse": 0.001}, curve, "rmse")["within_the_curve"]


def test_every_part_has_scenes_and_a_printer() -> None:
    for part in PARTS:
        assert part in ALONE or (DEFAULT_SCENES[part] and part in PRINTERS)
    assert parse(["--quick"]).runs == 1
    assert parse([]).runs == 5
    with pytest.raises(SystemExit):
        parse(["--truth-passes", "1"])
