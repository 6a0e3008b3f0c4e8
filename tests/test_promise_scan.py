"""What a scan leaves open: its own scale, its carriage's wave, where it lay; and what it settles all the same."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import Corruption, CrookedFrame, Drive, Play
from printmend.effects.prior import share_of
from printmend.errors import RefusedError, TraceError
from printmend.export.supported import export_supported
from printmend.learn.learned import learn_model, report
from printmend.machine import Frame
from printmend.measure.distance import RESIZED_SHARE, scaled_by, settled
from printmend.measure.fiducials import PAPER
from printmend.measure.measurement import freed_of_scanner, instrument_on_bed
from printmend.measure.page import resolution
from printmend.measure.table import read_trace, write_trace
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import judge_gcode
from printmend.mend.filament import learn_in, parse_travel
from printmend.mend.mend import is_healthy
from printmend.mend.prediction import advice_of, answer_to
from printmend.mend.update import update
from printmend.mend.verify import expectation, verify
from printmend.messages import say
from printmend.model import SavedModel
from printmend.model.model import refusals
from printmend.path import FLATBED, PAPER_SD, RESIZED, Instrument, Trace, distorted
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.promise.predict import (
    Promise,
)
from printmend.promise.words import scale_in_words, scale_words
from printmend.twin import Twin
from tests.promised import CIRCLE, ENDER3, HEALTHY, measured, scanned
from tests.test_greybox_learning import stairs


@pytest.fixture
def part(tmp_path: Path) -> Path:
    (tmp_path / "part.gcode").write_text(CIRCLE)
    return tmp_path / "part.gcode"


BLANK = np.full((64, 64, 3), 200, np.uint8)
STRETCH = np.diag([0.0013, 0.0013])


@pytest.fixture(scope="module")
def healthy() -> SavedModel:
    """What a healthy printer's scan tells that is too large by as much as a scanner may make it."""
    return learn_model(scanned(measured(HEALTHY, 0.01, 3), STRETCH), ENDER3)


def test_no_scanner_mends_a_healthy_printer(healthy: SavedModel, part: Path) -> None:
    uneven = np.array([[0.002, 0.0004], [0.0004, 0.001]])
    seen = scanned(measured(HEALTHY, 0.01, 3), uneven)
    far = learn_model(replace(seen, measured_mm=seen.measured_mm + 120.0), ENDER3)
    for model, stretch in ((healthy, STRETCH), (far, uneven)):
        done = mend_gcode(part, model, part.with_name("out.gcode"))
        assert done.output is not None
        assert done.output.read_bytes() == part.read_bytes()
        assert done.prediction.after.rms_high_mm < 0.2
        common = 100 * np.trace(stretch) / 2
        assert 100 * np.mean(model.document["promise"]["shown"]) == pytest.approx(common, abs=0.02)


def test_a_lens_that_bends_no_more_than_a_photo_does_is_mended_by_no_more() -> None:
    """No effect stands for a photo's lens: what it still bends is taken for bent guides, of a few hundredths."""
    seen = scanned(measured(HEALTHY, 0.002, 3, 400), np.zeros((2, 2)), PAPER)
    bend_mm = 0.01 * ((seen.commanded_mm - 110) / 100) ** 2
    model = learn_model(replace(seen, measured_mm=seen.measured_mm + bend_mm), ENDER3)
    way = stairs(100)
    moved = Twin(model.mechanism).follow(way) - way
    assert np.ptp(moved, axis=0).max() < 0.025
    bent = learn_model(replace(seen, measured_mm=seen.measured_mm + 20 * bend_mm), ENDER3)
    assert not is_healthy(bent)


def test_no_scanners_lens_mends_a_healthy_printer(part: Path, rng: np.random.Generator) -> None:
    """Neither by one scan nor by two, turned: those show what is the lens's, and one leaves it open."""
    trace = measured(HEALTHY, 0.0, 3)
    quarter = np.array([[0, 1], [-1, 0]])
    promised = []
    for ways in ([np.eye(2)], [np.eye(2), quarter]):
        turned = [(trace.measured_mm - 110.0) @ way for way in ways]
        seen = [off + distorted(off, 0) @ [0.15, 0.2, 0.1] + rng.normal(0, 0.01, off.shape) for off in turned]
        freed = freed_of_scanner(seen, FLATBED)
        upright = np.mean([place @ way.T for place, way in zip(freed.places_mm, ways, strict=True)], axis=0)
        instrument = instrument_on_bed(freed.instrument, [np.eye(2)], settled=freed.settled)
        model = learn_model(replace(trace, measured_mm=upright, placed=False, instrument=instrument), ENDER3)
        done = mend_gcode(part, model, part.with_name(f"{len(ways)}.gcode"))
        assert done.output is not None
        assert done.output.read_bytes() == part.read_bytes()
        assert done.prediction.after.rms_low_mm < 0.01
        promised.append(done.prediction.after.rms_high_mm)
    assert promised[0] > 1.5 * promised[1]


def test_a_scale_that_no_scanner_has_is_mended(part: Path) -> None:
    skewed = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.015, skew_deg=1.0))
    model = learn_model(scanned(measured(skewed, 0.01, 4), np.diag([0.0005, 0.0003])), ENDER3)
    said = check_gcode(part, model)
    assert said.before.rms_mm > 0.1
    assert said.after.made_of["instrument"] > 0.5 * said.after.rms_mm
    upper = part.with_name("upper.gcode")
    upper.write_text(CIRCLE + CIRCLE[CIRCLE.index("G1 Z") :].replace("Z0.2", "Z0.4").replace("X1", "X"))
    whole = check_gcode(upper, model)  # the upper layer lies elsewhere: without the part's place it is off otherwise
    length, rms, most = (
        np.array([row[k] for row in whole.layers]) for k in ("length_mm", "before_rms_mm", "before_max_mm")
    )
    assert rms.min() > 0.1
    assert (most >= rms).all()
    assert most.max() <= 1.001 * whole.before.max_mm
    assert np.sqrt(np.average(rms**2, weights=length)) == pytest.approx(whole.before.rms_mm, rel=0.05)
    layer = CIRCLE[CIRCLE.index("G1 Z") :]
    upper.write_text(CIRCLE + "".join(layer.replace("Z0.2", f"Z{0.2 * n:.1f}") for n in range(2, 90)))
    alike = np.array([row["before_rms_mm"] for row in check_gcode(upper, model).layers])
    assert alike == pytest.approx(alike.mean(), rel=0.25)  # each layer is the same circle
    mend_gcode(part, model, part.with_name("out.gcode"))
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(skewed, ENDER3))
    assert truth.after.rms_mm < 0.1 * truth.before.rms_mm
    surer = replace(FLATBED, scale_sd=0.0003, axes_sd=1e-4, lean_sd=1e-4)
    known = learn_model(scanned(measured(skewed, 0.01, 4), np.zeros((2, 2)), surer), ENDER3)
    assert check_gcode(part, known).after.rms_mm < 0.5 * said.after.rms_mm
    assert scale_words(known) == ()


def test_learn_says_what_scale_a_scan_leaves_open(healthy: SavedModel) -> None:
    wide = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.004, y_scale=1.004))
    model = learn_model(scanned(measured(wide, 0.01, 4), np.zeros((2, 2))), ENDER3)
    (said,) = scale_words(model)
    both = r"0\.4\d % too large in X and 0\.4\d % too large in Y"
    assert re.search(rf"the print is {both}.* usually 0\.1 .* Mending corrects none of that", said.replace("(", " "))
    assert said in report(model)
    assert (
        "Mending treats the print as 0.50 % too large in X and 0.03 % too small in Y, which may be wrong by 0.2 mm"
        in (scale_in_words(np.array([0.005, 0.001]), np.array([0.005, -3e-4]), 0.002, ""))
    )
    assert scale_words(healthy) == ()


def test_a_resized_picture_hides_the_scale_alone() -> None:
    """The errors of the print are as small in it as all else; an error of the picture is none of the print."""
    size_mm = 0.4
    played = measured(Corruption((Drive(belt=Play(size_mm)), Drive())), 0.004, 5, 150)
    true = scanned(played, np.zeros((2, 2)))
    small = scanned(played, np.zeros((2, 2)), RESIZED)
    small = replace(small, measured_mm=0.94 * small.measured_mm)
    known, model = learn_model(true, ENDER3), learn_model(small, ENDER3)
    newer = update(known, small, rng=np.random.default_rng(0))
    for found in (known, model, newer.model):
        (play,) = (row for row in found.document["diagnosis"] if row["kind"] == "play")
        assert abs(play["value"] - size_mm) < 0.002
        assert play["sd"] < 0.006  # a few draws have a printer of that scale, and play in the picture's size
        assert found.document["trace"]["residual_before_mm"] < size_mm
    assert newer.changes == ()
    (said,) = scale_words(model)
    assert re.search(r"the print is 6\.\d\d % too small in X and .* all of that may be the picture's\.", said)
    assert "0.2 %" not in said
    assert said.index("Scan again without fitting to a page") < said.index("`--distance`")
    before = verify(known, small)
    assert before.stretch_percent == pytest.approx(-6.0, abs=0.3)
    assert before.now_mm < size_mm


def test_a_scan_of_a_skewed_corexy_leaves_the_direction_of_x(part: Path) -> None:
    """No scan tells how a frame turns what it prints: x keeps its direction, however the plate lay on the glass."""
    corexy, skewed = read_printer("corexy"), Corruption((Drive(), Drive()), frame=CrookedFrame(skew_deg=2.6))
    sin = np.radians(-0.7)
    seen = scanned(measured(skewed, 0.01, 4, 300, corexy), np.array([[-(sin**2) / 2, -sin], [sin, -(sin**2) / 2]]))
    model = learn_model(seen, corexy)
    mend_gcode(part, model, part.with_name("out.gcode"))
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(skewed, corexy))
    assert truth.after.rms_mm < 0.03 < 0.3 < truth.before.rms_mm


@pytest.mark.usefixtures("all_rounds")
def test_a_scan_of_a_corexy_with_another_pulley_turns_no_print() -> None:
    """A motor whose scale is off by a tenth leans like a frame that is skewed by 5°: such a one would be seen."""
    corexy, rng = read_printer("corexy"), np.random.default_rng(2)
    points = np.vstack([[corexy.home_mm], rng.uniform(20, 280, (300, 2))])
    belts = corexy.to_motor(points - corexy.home_mm) * np.array([0.89, 0.98])
    printed = np.asarray(corexy.from_motor(belts)) + corexy.home_mm + rng.normal(0, 0.02, points.shape)
    model = learn_model(scanned(Trace(points, printed, homed=True), np.zeros((2, 2))), corexy)
    linear = [Frame.exponents.index(powers) for powers in ((1, 0), (0, 1))]
    matrix = model.mechanism.frame.coefficients_mm[:, linear]
    assert matrix[0, 1] - matrix[1, 0] == pytest.approx(0.0, abs=1e-6)
    assert {fault["kind"] for fault in model.document["diagnosis"]} == {"scale"}


def test_a_scan_of_a_skewed_frame_is_mended_whichever_axis_leans() -> None:
    """Which one leans is how the sheet lay; it makes no two causes of one skew, of which neither would be likely.

    On a CoreXY two opposite scales would lean, too: a crooked frame comes before them.
    """
    printer, skewed = read_printer("corexy"), Corruption((Drive(), Drive()), frame=CrookedFrame(skew_deg=0.6))
    model = learn_model(scanned(measured(skewed, 0.01, 4, 300, printer), np.zeros((2, 2))), printer)
    (skew,) = model.document["diagnosis"]
    assert (skew["part"], skew["kind"]) == ("frame", "skew")
    assert abs(skew["value"]) == pytest.approx(0.6, abs=0.06)
    assert 0.02 < skew["sd"] < 0.12
    assert "frame skewed by" in model.findings[0]
    frame = model.mechanism.frame
    (_, xy), (yx, _) = frame.coefficients_mm[:, [Frame.exponents.index(each) for each in ((1, 0), (0, 1))]]
    assert abs(xy + yx) / frame.scale_mm == pytest.approx(np.radians(0.6), abs=0.002)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_scanner_that_runs_unevenly_is_no_uneven_belt(axis: int, rng: np.random.Generator) -> None:
    """Neither in steps from line to line nor smoothly, as a bar that sags."""
    seen = scanned(measured(HEALTHY, 0.003, 3), np.zeros((2, 2)))
    place_mm = np.linspace(0, 220, 1101)
    jitter_mm = np.cumsum(rng.normal(0, 0.0015, 1101))  # 0.022 mm from one end of the bed to the other, each 0.2 mm
    for uneven_mm in (jitter_mm, 0.02 * np.cos(2 * np.pi * place_mm / 230)):
        off_mm = np.interp(seen.commanded_mm[:, axis], place_mm, uneven_mm)
        model = learn_model(replace(seen, measured_mm=seen.measured_mm + off_mm[:, None] * np.eye(2)[axis]), ENDER3)
        assert model.document["diagnosis"] == []


@pytest.mark.parametrize(
    ("frame", "kinds"),
    [
        (CrookedFrame(x_scale=1.01), {("x", "scale")}),  # X alone: Y keeps its length
        (CrookedFrame(x_scale=1.01, y_scale=1.0099), {("x", "scale"), ("y", "scale")}),  # alike, a picture may be
    ],
)
def test_a_stretch_that_no_scanner_has_is_the_simplest_faults(frame: CrookedFrame, kinds: set[tuple[str, str]]) -> None:
    crooked = Corruption((Drive(), Drive()), frame=frame)
    model = learn_model(scanned(measured(crooked, 0.01, 4, 300), np.zeros((2, 2))), ENDER3)
    assert {(fault["part"], fault["kind"]) for fault in model.document["diagnosis"]} == kinds


def test_one_distance_settles_the_scale(rng: np.random.Generator) -> None:
    true = rng.uniform(0, 150, (50, 2))
    true[:2] = [[10, 20], [110, 110]]
    stretch = np.array([[1.0025, 0.0], [0.0, 1.0025]])
    span_mm = float(np.hypot(100, 90)) + 1.6
    dots = np.full(2, 1.6 * 1.0025)
    again, left, note = scaled_by(span_mm, (0, 1), dots, true @ stretch, replace(FLATBED, axes_sd=1e-4, lean_sd=1e-4))
    assert np.ptp(again - true, axis=0).max() < 0.2 * np.ptp(true @ stretch - true, axis=0).max()
    assert left.scale_sd < 0.0005
    assert "the image is 0.25 % too large. That is corrected" in note
    assert "the image is 0.25 % too small" in settled(-0.0025, 0.0, 140.0, FLATBED)[2]
    with pytest.raises(TraceError, match=r"dot 0 to dot 1.* measure it again"):
        scaled_by(120.0, (0, 1), dots, true, FLATBED)
    with pytest.raises(TraceError, match="the picture was resized: take it again"):
        scaled_by(110.0, (0, 1), dots, true, RESIZED, say("scale-from-dpi-resized", "300"))


def test_paper_that_grew_makes_no_printer_faulty(part: Path) -> None:
    """Two scans and a distance all show the sheet as it is now: only the travel of the head tells its scale."""
    _, plate, _ = settled(0.0, 1.2, 140.0, replace(FLATBED, axes_sd=1e-4, lean_sd=1e-4))
    paper = replace(plate, paper_sd=PAPER_SD)
    grown = scanned(measured(HEALTHY, 0.01, 3), np.diag([0.0018, 0.0003]), paper)
    model = learn_model(grown, ENDER3)
    assert is_healthy(model)
    assert "give it to `learn --update` (--travel" in report(model)
    assert not is_healthy(learn_model(replace(grown, instrument=plate), ENDER3))
    told = learn_in(grown, ENDER3, None, [parse_travel("x=200:200"), parse_travel("y=200:200")])
    assert scale_words(told) == ()
    assert "--travel" in str(answer_to(model, "instrument"))
    assert "as far as the reading left it open" in str(answer_to(told, "instrument"))
    large = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.006))
    known = learn_model(scanned(measured(large, 0.01, 4), np.diag([0.0004, 0.0001]), paper), ENDER3)
    mend_gcode(part, known, part.with_name("out.gcode"))
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(large, ENDER3))
    assert truth.after.rms_mm < 0.3 * truth.before.rms_mm


def test_a_distance_that_slipped_makes_no_printer_faulty(rng: np.random.Generator) -> None:
    """Either the picture is of another size, or the jaws slipped: what the marks show decides."""
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (250, 2))])
    span = (1, int(np.argmin(np.abs(np.hypot(*(points - points[1]).T) - 140.0))))
    right_mm = float(np.hypot(*(points[span[0]] - points[span[1]]))) + 1.6
    for resized, given_mm in ((1.0, right_mm + 2.0), (1.014, right_mm)):
        seen = points * resized + rng.normal(0, 0.01, points.shape)
        settled_mm, left, note = scaled_by(given_mm, span, np.full(2, 1.6 * resized), seen, FLATBED)
        assert left.scale_sd > 0.003
        assert note.startswith("warning: by the callipers, the image is 1.")
        assert "Measure again; until then, only part of it is corrected" in note
        assert is_healthy(learn_model(Trace(points, settled_mm, homed=True, placed=False, instrument=left), ENDER3))
    twice = settled(0.02, 0.0, 140.0, settled(0.0, 0.0, 140.0, FLATBED)[1], reading_mm=0.01, slip_share=0.0)[0]
    assert twice[0, 0] == pytest.approx(1.02, abs=0.001)  # a ruler's lines do not slip, whatever was known before
    assert share_of("resized") == RESIZED_SHARE
    usual = settled(0.0015, np.pi / 4, 140.0, FLATBED)
    assert usual[1].scale_sd < 0.0007
    assert "Measure again" not in usual[2]


def test_a_trace_keeps_what_its_instrument_cannot_tell(tmp_path: Path) -> None:
    trace = replace(measured(HEALTHY, 0.01, 5, 30), placed=False, instrument=FLATBED)
    write_trace(tmp_path / "t.csv", trace)
    assert read_trace(tmp_path / "t.csv", ENDER3).instrument == FLATBED
    unknown = replace(trace, instrument=None).instrument_doubt  # how the plate lay is not known: no axis is surer
    assert unknown.axes_sd == unknown.lean_sd
    assert 2 * unknown.lean_sd**2 == pytest.approx(FLATBED.axes_sd**2 + FLATBED.lean_sd**2, rel=0.05)
    assert replace(trace, instrument=None, placed=True).instrument_doubt.is_exact
    text = (tmp_path / "t.csv").read_text()
    (tmp_path / "bad.csv").write_text(text.replace("0.001300", "7"))
    with pytest.raises(TraceError, match="scale_sd from 0"):
        read_trace(tmp_path / "bad.csv", ENDER3)


def test_a_length_that_was_given_is_not_asked_for_again() -> None:
    """One distance settles the scale along it: a second scan, turned, what is left across it."""
    stretched = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.0027, y_scale=1.0008))
    doubt = Promise(0.05, 0.1, 0.2, 0.02, 0.09, 0.0, 0.001, {"planning": 0.001, "instrument": 0.049})
    both = settled(0.0, 0.0, 140.0, instrument_on_bed(FLATBED, [np.eye(2)], settled=True))[1]
    whole = learn_model(scanned(measured(stretched, 0.01, 4), np.zeros((2, 2)), both), ENDER3)
    left_open = ("most of the remaining error is the scale, as far as the reading left it open",)
    assert advice_of(whole, doubt) == left_open
    odd = {**whole.document["promise"], "instrument": {"scale_axes": 0.1, "axes_sd": "0.1", "scale_sd": [0.1]}}
    assert "second scan" in advice_of(replace(whole, document={**whole.document, "promise": odd}), doubt)[0]
    for instrument, is_known in ((FLATBED, False), (settled(0.0, 0.0, 140.0, FLATBED)[1], True)):
        model = learn_model(scanned(measured(stretched, 0.01, 4), np.zeros((2, 2)), instrument), ENDER3)
        for said in (*scale_words(model), *advice_of(model, doubt)):
            assert ("--distance" in said) != is_known
            assert ("second scan turned by a quarter settles it" in said) == is_known


def test_a_wave_along_the_bed_that_two_scans_show_is_mended(rng: np.random.Generator) -> None:
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (250, 2))])
    wave = 0.022 * np.sin(points[:, 1] / 61.0 * 2 * np.pi)
    measured = points + np.stack([np.zeros(len(points)), wave], axis=1) + rng.normal(0, 0.01, points.shape)
    twice = instrument_on_bed(FLATBED, [np.eye(2)], settled=True)
    model = learn_model(Trace(points, measured, homed=True, placed=False, instrument=twice), ENDER3)
    left = (Twin(model.mechanism).follow(points) - points)[:, 1] - wave
    assert np.std(left) < 0.4 * np.std(wave)


@pytest.mark.parametrize(
    ("instrument", "axes"),
    [
        (FLATBED.known(0.0005), (1,)),  # one scan of a scanner whose lengths are known
        (instrument_on_bed(replace(FLATBED, wave_mm=0.007), [np.eye(2)], settled=True), (0, 1)),  # two that disagree
    ],
)
def test_a_wave_that_the_carriage_may_have_made_is_left(
    instrument: Instrument, axes: tuple[int, ...], rng: np.random.Generator
) -> None:
    """However well a length or the axes are known: the mean of two scans still holds half of either's wave."""
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (250, 2))])
    measured = points + rng.normal(0, 0.002, points.shape)
    measured[:, axes] += 0.01 * np.sin(points[:, axes] / 61 * 2 * np.pi)
    model = learn_model(Trace(points, measured, homed=True, placed=False, instrument=instrument), ENDER3)
    assert is_healthy(model)


@pytest.mark.parametrize("is_pulleys", [True, False])
def test_a_wave_that_lies_as_the_picture_does_is_the_carriages(rng: np.random.Generator, *, is_pulleys: bool) -> None:
    """A sheet lies turned by 0.3°: the front of a wave of 40 ÷ 4 mm tells the scanner's from a cornered pulley's."""
    instrument = replace(FLATBED.known(0.0005), turn_y_rad=0.006)
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (250, 2))])
    way = np.array([0.0, 1.0]) if is_pulleys else instrument.ways[1]
    wave = 0.03 * np.sin(2 * np.pi * (points - ENDER3.home_mm) @ way / 10)
    measured = points + wave[:, None] * way + rng.normal(0, 0.006, points.shape)
    model = learn_model(Trace(points, measured, homed=True, placed=False, instrument=instrument), ENDER3)
    found = [(fault["part"], fault["kind"]) for fault in model.document["diagnosis"]]
    assert found == [("y", "harmonic-4")] * is_pulleys


def test_no_firmware_gets_the_stretch_of_a_scanner(healthy: SavedModel) -> None:
    for firmware in ("marlin", "klipper", "rrf", "linuxcnc"):
        with pytest.raises(RefusedError, match="leave its settings as they are: there is nothing to mend"):
            export_supported(healthy, firmware)


def test_a_pulley_of_a_far_other_size_is_learned_from_a_scan() -> None:
    """What such a printer misses is tens of millimetres in the middle of the bed, and nothing at home."""
    printer = read_printer("corexy")
    plan = design_probe(printer)
    printed = np.asarray(printer.from_motor(printer.to_motor(plan.marks_mm) * [49.0 / 40.0, 41.5 / 40.0]))
    seen = printed + np.random.default_rng(3).normal(0, 0.02, printed.shape) + [60.0, 80.0]
    document = learn_model(plan.trace(seen), printer).document
    assert not refusals(document)
    assert document["trace"]["residual_after_mm"] < 0.04


def test_small_play_is_as_large_as_it_is_said_to_be(rng: np.random.Generator) -> None:
    """However uneven the carriage runs: it follows the place, and play the direction."""
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (250, 2))])
    twin = Twin.of(Corruption((Drive(belt=Play(0.04)), Drive())), ENDER3)
    measured = twin.follow(points) + rng.normal(0, 0.01, points.shape)
    scan = Trace(points, measured, homed=True, placed=False, instrument=replace(FLATBED, wave_mm=0.02))
    (play,) = learn_model(scan, ENDER3).document["diagnosis"]
    assert (play["part"], play["kind"]) == ("x", "play")
    assert abs(play["value"] - 0.04) < 3 * play["sd"] < 0.03


def test_a_picture_of_another_size_is_not_mended_until_a_length_is_known(rng: np.random.Generator) -> None:
    """A resolution that was typed in wrongly looks like two axes that are off by the same."""
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (250, 2))])
    measured = 1.035 * points + rng.normal(0, 0.005, points.shape)
    scan = Trace(points, measured, homed=True, placed=False, instrument=resolution(BLANK, 600.0, 300.0)[2])
    model = learn_model(scan, ENDER3)
    assert is_healthy(model)
    promise = expectation(model, scan)
    assert promise is not None
    assert promise.rms_low_mm < 0.01
    assert promise.rms_high_mm > 1.0
    _, _, known = resolution(BLANK, 600.0, stated=599.9988)
    assert not is_healthy(learn_model(replace(scan, instrument=known), ENDER3))
