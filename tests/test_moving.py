"""Lines at speed: what they show of a moving head, and what the promise makes of it."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from printmend.gcode.read import read_gcode
from printmend.learn.learned import learn_model
from printmend.measure import read_plan, write_plan
from printmend.measure.image import write_image
from printmend.measure.measurement import measure_scans
from printmend.measure.plan import ProbePlan
from printmend.measure.table import read_trace, write_trace
from printmend.path import Motion
from printmend.probe import cost, design_probe, probe_gcode
from printmend.probe.layout import with_moving
from printmend.promise.belief import belief_of
from printmend.promise.predict import UNSHOWN_MM, unshown_mm
from printmend.twin import Twin
from printmend.twin.gcode import print_dots, print_line
from printmend.twin.scanner import DEFAULT, render_scan
from tests.mending import PLAY, mended
from tests.promised import ENDER3, HEALTHY, measured

EVEN = (np.arange(400) + 0.5) / 400


@pytest.fixture(scope="module")
def plan() -> ProbePlan:
    return with_moving(design_probe(ENDER3, size_mm=60), ENDER3)


def ringing(plan: ProbePlan, size_mm: float) -> np.ndarray:
    """Return the way [N, 2] of the lines with both axes ringing after each corner, ``size_mm`` (RMS) across a leg."""
    corners, points, length_mm = plan.waypoints_mm[plan.moving :], [], 9.0
    for start, end in itertools.pairwise(corners):
        gone = np.arange(0.0, np.hypot(*(end - start)), 0.05)
        along = (end - start) / np.hypot(*(end - start))
        off = np.exp(-gone / length_mm) * np.sin(2 * np.pi * gone / 1.7)
        points.append(start + gone[:, None] * along + np.outer(off, [-along[1], along[0]]))
    way = np.vstack(points)
    ideal = np.exp(-np.arange(0.8, 8.2, 0.05) / length_mm) * np.sin(2 * np.pi * np.arange(0.8, 8.2, 0.05) / 1.7)
    straight = np.vstack([
        s + np.outer(np.arange(0.0, np.hypot(*(e - s)), 0.05), (e - s) / np.hypot(*(e - s)))
        for s, e in itertools.pairwise(corners)
    ])  # fmt: skip
    return straight + (way - straight) * size_mm / np.sqrt(np.mean(ideal**2))


@pytest.mark.parametrize("size_mm", [0.0, 0.02])
def test_lines_at_speed_show_how_far_the_head_strays(tmp_path, plan, size_mm):
    scan = render_scan(
        plan.marks_mm, plan, degradations=replace(DEFAULT, stretch=0.0), rng=np.random.default_rng(3),
        line_mm=ringing(plan, size_mm),
    )  # fmt: skip
    write_image(tmp_path / "scan.png", scan.image, dpi=scan.dpi)
    motion = measure_scans([tmp_path / "scan.png"], plan).trace.motion
    assert motion is not None
    assert abs(motion.square_mm2 - size_mm**2) < 3 * motion.sd_mm2
    assert motion.sd_mm2 < 0.008**2 + 0.5 * size_mm**2


def test_dots_are_read_as_without_the_lines(tmp_path, plan):
    found = []
    for line in (None, plan.waypoints_mm[plan.moving :]):
        scan = render_scan(plan.marks_mm, plan, degradations=DEFAULT, rng=np.random.default_rng(1), line_mm=line)
        write_image(tmp_path / "scan.png", scan.image, dpi=scan.dpi)
        found.append(measure_scans([tmp_path / "scan.png"], plan))
    assert found[0].motion is None
    assert len(found[1].missing) == len(found[0].missing)


def test_the_file_prints_every_way_point_and_says_its_seconds(plan):
    bare = design_probe(ENDER3, size_mm=60)
    np.testing.assert_array_equal(plan.waypoints_mm[: plan.moving], bare.waypoints_mm)
    program = read_gcode(probe_gcode(plan).encode(), printer=ENDER3)
    printed = print_dots(program, Twin.of(HEALTHY, ENDER3), plan)
    np.testing.assert_allclose(printed, plan.marks_mm, atol=1e-6)
    line = print_line(program, Twin.of(HEALTHY, ENDER3), plan)
    assert line is not None
    np.testing.assert_allclose(line[[0, -1]], plan.waypoints_mm[[plan.moving, -1]], atol=1e-4)
    assert 0 < 60 * (cost(plan)[0] - cost(bare)[0]) < 30


def test_a_mended_file_has_the_plans_dots_whatever_begins_its_lines(plan):
    text, _ = mended(probe_gcode(plan).encode(), PLAY)
    printed = print_dots(read_gcode(text, printer=ENDER3), Twin(PLAY), plan)
    np.testing.assert_allclose(printed, plan.marks_mm, atol=0.01)


def test_plan_and_table_keep_them(tmp_path, plan):
    write_plan(tmp_path / "probe.json", plan)
    assert read_plan(tmp_path / "probe.json").moving == plan.moving
    trace = replace(measured(HEALTHY, 0.01, 1, 60), motion=Motion(1.7e-5, 4e-6))
    write_trace(tmp_path / "trace.csv", trace)
    assert read_trace(tmp_path / "trace.csv", ENDER3).motion == trace.motion


def test_a_measured_motion_narrows_the_promise() -> None:
    """The posterior of a log-normal prior: nothing told is the prior, a sure square is that square."""
    prior = unshown_mm(EVEN, None)
    np.testing.assert_allclose(unshown_mm(EVEN, Motion(0.0, 1e3)), prior, rtol=0.01)
    sure = unshown_mm(EVEN, Motion(0.5 * 0.01**2, 1e-6))
    np.testing.assert_allclose(np.quantile(sure, (0.05, 0.95)), 0.01, rtol=0.05)
    still = unshown_mm(EVEN, Motion(0.0, 1e-5))
    assert np.quantile(still, 0.95) < 0.008 < np.quantile(prior, 0.95)
    assert np.median(still) < UNSHOWN_MM + 1e-4


def test_a_model_keeps_what_lines_showed() -> None:
    motion = Motion(1.7e-5, 4e-6)
    model = learn_model(replace(measured(HEALTHY, 0.01, 1), motion=motion), ENDER3)
    assert belief_of(model).motion == motion
