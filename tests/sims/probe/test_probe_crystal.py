"""The probe's hardware count as a function of the cell's time."""

import pytest

from sims.probe._firmware import Crystal

SECOND = 1_000_000_000


@pytest.mark.parametrize("seed", range(20))
def test_the_count_runs_at_two_megahertz_within_fifty_ppm(seed):
    crystal = Crystal.from_seed(seed)
    ticks = (crystal.tick(101 * SECOND) - crystal.tick(1 * SECOND)) % 2**32
    assert abs(ticks / 200_000_000 - 1) <= 50e-6
    assert ticks == pytest.approx(200_000_000 * (1 + crystal.drift_ppm * 1e-6), abs=1)


def test_probes_of_different_seeds_differ_and_of_the_same_seed_do_not():
    counts = {Crystal.from_seed(seed).tick(0) for seed in range(20)}
    assert len(counts) == 20
    assert Crystal.from_seed(3).tick(SECOND) == Crystal.from_seed(3).tick(SECOND)


def test_the_count_wraps_at_32_bits():
    crystal = Crystal(0.0, 2**32 - 2, 0)
    assert [crystal.tick(ns) for ns in (0, 500, 999, 1000, 1500)] == [2**32 - 2, 2**32 - 1, 2**32 - 1, 0, 1]


def test_a_reset_begins_the_count_anew_with_the_same_drift():
    crystal = Crystal.from_seed(1)
    restarted = crystal.restarted(5 * SECOND)
    assert restarted.tick(5 * SECOND) == 0
    assert restarted.drift_ppm == crystal.drift_ppm
