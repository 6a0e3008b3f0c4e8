"""The machine's laws against their slow twins: play, the way onto the bed and back, tables."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.jit import record
from printmend.machine import BedMap, share_behind
from printmend.machine.kernels import bed, play, table
from printmend.path import last_way
from tests import naive_law

PLACES = st.floats(-2000.0, 2000.0)


@settings(deadline=None)
@given(PLACES, PLACES, st.floats(0.0, 50.0))
def test_play_clips_and_says_what_it_touches(position: float, lower: float, width: float) -> None:
    after, side = play.contact(position, lower, lower + width)
    assert after == play.clip(position, lower, lower + width) == naive_law.clip(position, lower, lower + width)
    assert side == np.sign(position - after)
    assert play.rest(lower, lower + width, 0.0) == lower


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_the_way_onto_the_bed_and_back(seed: int, corexy: bool) -> None:
    rng = np.random.default_rng(seed)
    coefficients, origin = rng.normal(0.0, 2.0, (2, 10)), rng.uniform(-50.0, 50.0, 2)
    scale, belts = rng.uniform(400.0, 600.0, 2), rng.uniform(0.0, 500.0, 2)
    count = int(rng.integers(0, bed.MOST_WAVES + 1))
    rates, sizes = (
        rng.normal(0.0, 10.0, (bed.MOST_WAVES, 2)),
        rng.normal(0.0, 0.5 / bed.MOST_WAVES, (bed.MOST_WAVES, 4)),
    )
    waves = np.hstack([rates, sizes])
    values = BedMap(corexy, coefficients, origin, scale, waves[:count]).record
    values.waves[:] = waves.view(bed.WAVE).ravel()  # those beyond the count are none

    def onto_bed(place: np.ndarray) -> np.ndarray:
        bent = naive_law.onto_bed(coefficients, origin, scale, place)
        return bent + naive_law.waved(waves[:count], origin, scale, place)

    motors = bed.to_motors(values, *belts)
    assert motors == ((belts[0] + belts[1], belts[0] - belts[1]) if corexy else tuple(belts))
    place = np.array(bed.printed(values, *motors))
    np.testing.assert_allclose(place, onto_bed(belts), rtol=0, atol=1e-10)
    np.testing.assert_allclose(bed.wanted(values, *place), motors, rtol=0, atol=1e-8)
    step, slopes = 1e-3, bed.slopes(values, *belts)
    for axis, (by, other) in enumerate(((slopes[0], slopes[2]), (slopes[1], slopes[3]))):
        ends = [onto_bed(belts + s * step * np.eye(2)[axis]) for s in (-1, 1)]
        np.testing.assert_allclose((ends[1] - ends[0]) / (2 * step), (by, other), rtol=0, atol=1e-6)
    bed.anchor(values, *belts)
    np.testing.assert_allclose(bed.onto_bed(values, *belts), belts, rtol=0, atol=1e-10)


def test_a_straight_frame_changes_nothing() -> None:
    values = record(bed.BED)
    assert bed.onto_bed(values, 3.0, 4.0) == bed.off_bed(values, 3.0, 4.0) == (3.0, 4.0)
    assert bed.slopes(values, 3.0, 4.0) == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("begin", [0, 3])
def test_tables_are_straight_between_their_entries(begin: int, rng: np.random.Generator) -> None:
    entries = np.cumsum(rng.uniform(0.0, 1.0, 9))
    values = np.concatenate([np.full(begin, np.nan), entries])
    for m in rng.uniform(1.0, 11.0, 100):
        ours = table.branch_at(values, begin, 2.0, 2.0, 8.0, m)
        assert ours == pytest.approx(naive_law.branch_at(entries, 2.0, 0.5, m), abs=1e-12)
        push = table.push_at(values, begin, 2.0, 2.0, 8.0, m)
        assert push == pytest.approx(np.interp(m, 2.0 + 0.5 * np.arange(9), entries), abs=1e-12)


def test_what_has_play_follows_within_it(rng: np.random.Generator) -> None:
    drive_mm, play_mm = np.cumsum(rng.normal(0, 0.2, 500)), 0.7
    follows_mm, expected = drive_mm[0], []
    for place_mm in drive_mm:
        follows_mm = min(max(follows_mm, place_mm - play_mm / 2), place_mm + play_mm / 2)
        expected.append((place_mm - follows_mm) / (play_mm / 2))
    share = share_behind(drive_mm, play_mm)
    assert share == pytest.approx(np.array(expected), abs=1e-12)
    assert (np.abs(share) < 0.99).any()
    assert np.array_equal(share_behind(10 * drive_mm, 1e-6).round()[1:], last_way(drive_mm)[1:])
