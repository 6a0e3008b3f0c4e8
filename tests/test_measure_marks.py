"""Which dot is which mark: points instead of pixels, for every family of faults, any pose, dirt and loss."""

import numpy as np
import pytest

from printmend.errors import ConfigError
from printmend.measure.marks import Marks, read_marks
from printmend.measure.plan import ProbePlan
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.sampling import families, sample

PRINTER = read_printer("ender3")
# these can throw neighbouring rows apart by more than the marks' distance: a refusal is right, a mistake never
VIOLENT = ("jumps", "everything", "pulley-loose")
# a gain table is no machine; the others are a part of a family that is tried
SIMPLE = ("gain-table", "radius", "eccentric", "ellipse", "polygon", "flat", "tabulated", "play", "loose", "set-screw")


@pytest.fixture(scope="module")
def plan() -> ProbePlan:
    return design_probe(PRINTER)


@pytest.fixture(scope="module")
def small() -> ProbePlan:
    return design_probe(PRINTER, size_mm=120)


def seen(
    plan: ProbePlan,
    printed: np.ndarray,
    rng: np.random.Generator,
    *,
    lost: float | np.ndarray,
    dust: int,
    mirrored: bool,
) -> tuple[Marks | None, np.ndarray]:
    """Lay the print on the glass at any angle; return what is read and which dot each mark really is (−1: lost)."""
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    kept = np.flatnonzero(rng.random(len(plan)) >= lost) if isinstance(lost, float) else np.flatnonzero(~lost)
    dots = (printed * [-1.0 if mirrored else 1.0, -1.0] @ turn)[kept] + rng.normal(0, 0.02, (len(kept), 2))
    specks = rng.uniform(dots.min(axis=0), dots.max(axis=0), (dust, 2))
    sizes = np.concatenate([plan.diameter_mm[kept] * (1 + rng.normal(0, 0.06, len(kept))), rng.uniform(0.6, 1.6, dust)])
    order = rng.permutation(len(sizes))
    truth = np.full(len(plan), -1)
    truth[kept] = np.argsort(order)[: len(kept)]
    return read_marks(np.vstack([dots, specks])[order], sizes[order], plan), truth


@pytest.mark.parametrize(
    ("family", "severity"),
    [*((name, "damaged") for name in families() if name not in SIMPLE), *((name, "realistic") for name in VIOLENT)],
)
def test_no_mark_is_taken_for_another(plan, small, family, severity):
    rng = np.random.default_rng(list(families()).index(family))
    try:
        corruption = sample(family, rng, severity=severity)
    except ConfigError:
        pytest.skip("this draw is no machine")
    plan = plan if severity == "damaged" else small
    printed = Twin.of(corruption, PRINTER).follow(plan.waypoints_mm)[plan.rows]
    mirrored = bool(rng.random() < 0.5)
    marks, truth = seen(plan, printed, rng, lost=0.02, dust=10, mirrored=mirrored)
    if marks is None:
        assert severity == "damaged"
        assert family in VIOLENT
        return
    claimed = marks.found & (marks.match.dot != truth)
    assert not np.isin(marks.match.dot[claimed], truth[truth >= 0]).any()
    if family not in VIOLENT:
        assert marks.found.sum() >= 0.98 * (truth >= 0).sum()
        assert marks.match.mirrored == mirrored


def lost_marks(kind: str, plan: ProbePlan, rng: np.random.Generator) -> np.ndarray:
    """Return which three tenths of the marks [M] came off: any of them, one corner, or a stripe across the plate."""
    if kind == "any":
        return rng.random(len(plan)) < 0.3
    from_corner = np.abs(plan.marks_mm - plan.marks_mm.max(axis=0))
    if kind == "corner":
        return from_corner.max(axis=1) < np.quantile(from_corner.max(axis=1), 0.3)
    low, high = np.quantile(plan.marks_mm[:, 0], (0.35, 0.65))
    return (plan.marks_mm[:, 0] > low) & (plan.marks_mm[:, 0] < high)


@pytest.mark.parametrize(("kind", "family"), [("any", "frame"), ("corner", "pulley-play"), ("stripe", "pulley-play")])
def test_where_three_tenths_of_the_marks_came_off_the_others_are_told(plan, kind, family):
    rng = np.random.default_rng([len(kind), len(family)])
    printed = Twin.of(sample(family, rng, severity="damaged"), PRINTER).follow(plan.waypoints_mm)[plan.rows]
    marks, truth = seen(plan, printed, rng, lost=lost_marks(kind, plan, rng), dust=10, mirrored=False)
    assert marks is not None
    claimed = marks.found & (marks.match.dot != truth)
    assert not np.isin(marks.match.dot[claimed], truth[truth >= 0]).any()
    assert marks.found.sum() > 0.93 * (truth >= 0).sum()


@pytest.mark.parametrize("size_mm", [40, 70, 120])
def test_a_piece_of_another_plate_is_none_of_ours(plan, size_mm):
    other = design_probe(PRINTER, marks=590)
    near = np.abs(other.marks_mm - other.marks_mm.mean(axis=0)).max(axis=1) < size_mm / 2
    assert read_marks(other.marks_mm[near] * [1.0, -1.0], other.diameter_mm[near], plan) is None


def test_spare_dots_beside_a_whole_print_do_no_harm(plan):
    marks, truth = seen(plan, plan.marks_mm, np.random.default_rng(1), lost=0.0, dust=12, mirrored=False)
    assert marks is not None
    np.testing.assert_array_equal(marks.match.dot, truth)


def test_marks_after_one_skipped_tooth_are_kept(plan):
    printed = plan.marks_mm.copy()
    printed[250:, 0] += 2.0
    marks, truth = seen(plan, printed, np.random.default_rng(2), lost=0.0, dust=0, mirrored=False)
    assert marks is not None
    # after a skipped tooth a mark beside its place may be another one: it is left out, never taken for one
    assert (marks.match.dot == truth)[marks.found].all()
    assert marks.found.mean() > 0.92


@pytest.mark.parametrize("seed", range(3))
def test_many_skipped_teeth_lose_marks_but_mix_none_up(plan, seed):
    rng = np.random.default_rng(seed)
    printed = plan.marks_mm.copy()
    for row in rng.integers(20, len(plan) - 20, 5):
        printed[row:] += 2.0 * rng.permutation([rng.choice([-1, 1]), 0])
    marks, truth = seen(plan, printed, rng, lost=0.02, dust=10, mirrored=False)
    if marks is not None:
        claimed = marks.found & (marks.match.dot != truth)
        assert not np.isin(marks.match.dot[claimed], truth[truth >= 0]).any()


def test_a_random_page_is_no_probe(plan):
    rng = np.random.default_rng(3)
    assert read_marks(rng.uniform(0, 200, (600, 2)), rng.uniform(0.8, 1.7, 600), plan) is None


def test_too_few_dots_are_no_probe(plan):
    assert read_marks(plan.marks_mm[:5], plan.diameter_mm[:5], plan) is None
