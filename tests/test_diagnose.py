"""The diagnosis as a document: the right faults, the right advice, a true picture of the pulley, one whole file."""

import base64
import html
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import (
    HEALTHY,
    Corruption,
    CrookedFrame,
    Drive,
    EccentricBore,
    Ellipse,
    Play,
    corruption_of,
)
from printmend.diagnosis.advice import advise
from printmend.effects.words import Fault as NamedFault
from printmend.errors import GcodeError, InputError, TraceError
from printmend.learn.learned import learn_model, report
from printmend.measure.table import read_trace, write_trace
from printmend.mend.mend import check_gcode
from printmend.messages import catalogue, say
from printmend.path import FLATBED, Instrument, Trace
from printmend.printer import Homing, Printer, read_printer
from printmend.printer.printer import Switch
from printmend.probe import design_probe
from printmend.report.examination import Examination, examine, standard_rows, summary
from printmend.report.examination_file import write_examination
from printmend.report.pictures import pictures
from printmend.twin import Twin
from printmend.units import TURN_RAD, radius_mm
from printmend_lab.greybox.greybox import Greybox
from tests.mending import SQUARE

pytestmark = pytest.mark.usefixtures("once")
ENDER3 = read_printer("ender3")
BROKEN = Corruption(
    (Drive(pulley=EccentricBore(0.8, 1.0), belt=Play(0.6)), Drive(pulley=Ellipse(6.6, 6.1, 0.4))),
)


def probe_trace(corruption: Corruption, printer: Printer, noise_mm: float = 0.02, seed: int = 1) -> Trace:
    plan = design_probe(printer, marks=300)
    marks = Twin.of(corruption, printer).follow(plan.waypoints_mm)[plan.rows]
    noise = np.random.default_rng(seed).normal(0, noise_mm, marks.shape)
    return plan.trace(marks + noise)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with trace.csv of the broken printer and a part with a name with what a page must escape."""
    folder = tmp_path_factory.mktemp("diagnose")
    write_trace(folder / "trace.csv", replace(probe_trace(BROKEN, ENDER3), placed=True))
    (folder / "part <1>.gcode").write_bytes(SQUARE)
    return folder


@pytest.fixture(scope="module")
def examined(folder: Path) -> Examination:
    trace = read_trace(folder / "trace.csv", ENDER3)
    return examine(trace, ENDER3, part=folder / "part <1>.gcode", rng=np.random.default_rng(0))


def run(*args: object):
    return CliRunner().invoke(group, [str(arg) for arg in args])


def test_names_what_is_broken_and_what_to_do(examined: Examination) -> None:
    found = {one.title: one for one in examined.advice}
    assert found["X pulley is off its centre"].urgency == "repair"
    assert found["X belt has play"].effect_mm == pytest.approx(0.6, abs=0.02)
    assert "Tighten the belt" in found["X belt has play"].repair
    assert found["Y pulley is oval"].effect_mm == pytest.approx(0.25 / 2, abs=0.02)
    assert not any(title.startswith("Y belt") for title in found)


def test_unlike_axes_of_a_corexy_are_named(rng: np.random.Generator) -> None:
    """Its motors move both axes: no scale of theirs makes X too large and Y too small. What both axes have alike is
    theirs where the instrument is known."""
    printer = read_printer("corexy")
    points = np.vstack([[printer.home_mm], rng.uniform(20, 280, (200, 2))])
    squeezed = (points - printer.home_mm) * [1.004, 0.994] + printer.home_mm
    measured = squeezed + rng.normal(0, 0.02, points.shape)
    model = learn_model(Trace(points, measured, homed=True, instrument=Instrument(scale_sd=1e-4)), printer)
    (axes,) = (fault for fault in model.document["diagnosis"] if fault["kind"] == "axes")
    assert (axes["part"], axes["unit"]) == ("frame", "%")
    assert axes["value"] == pytest.approx(1.0, abs=4 * axes["sd"] + 1e-3)
    assert re.search(r"frame X prints (0\.99|1\.0)\d+ ± 0\.00\d+ % larger than Y", model.findings[0])
    scales = [fault for fault in model.document["diagnosis"] if fault["kind"] == "scale"]
    assert [fault["part"] for fault in scales] == ["a", "b"]
    assert [fault["value"] for fault in scales] == pytest.approx([-0.1, -0.1], abs=4 * scales[0]["sd"] + 1e-3)


def test_a_crooked_frame_shifts_no_motor_and_points_that_are_left_out_count_for_nothing(
    rng: np.random.Generator,
) -> None:
    printer = read_printer("ender3")
    points = np.vstack([[printer.home_mm], rng.uniform(20, 200, (250, 2))])
    twin = Twin.of(Corruption((Drive(), Drive()), CrookedFrame(skew_deg=0.6)), printer)
    measured = twin.follow(points) + rng.normal(0, 0.02, points.shape)
    typical_mm = np.sqrt(np.square(measured - points).sum(axis=1).mean())
    measured[10::20, 0] += 6.0
    examination = examine(Trace(points, measured, homed=True), printer, rng=rng)
    assert examination.before_rms_mm == pytest.approx(typical_mm, rel=0.1)
    assert examination.after_rms_mm < 0.05
    assert "mm RMS over 251 points, 13 of them left out. Unexplained: 0." in report(examination.saved)
    assert re.match("X healthy; Y healthy; frame skewed by 0.(59|60)", examination.saved.findings[0])
    assert "too small" not in examination.headline


def test_a_motor_that_skipped_is_said_before_each_print(tmp_path: Path, rng: np.random.Generator) -> None:
    printer = read_printer("ender3")
    points = np.vstack([[printer.home_mm], rng.uniform(20, 200, (300, 2))])
    measured = Twin.of(Corruption((Drive(), Drive())), printer).follow(points) + rng.normal(0, 0.03, points.shape)
    measured[200:, 0] += 2.0
    model = learn_model(Trace(points, measured, homed=True), printer)
    assert model.is_healthy
    part = tmp_path / "part.gcode"
    part.write_text("G21\nG90\nM83\nG28\nG0 X60 Y60 Z0.2 F6000\nG1 X160 Y60 E3 F1800\nG1 X160 Y160 E3\n")
    said = check_gcode(part, model).advice[0]
    assert said.startswith("X skipped by +2.00 mm during the test print")
    assert f"warning: {said}" in report(model)


def test_what_turns_by_another_length_may_be_an_idler(rng: np.random.Generator) -> None:
    printer = read_printer("ender3")
    points = np.vstack([[printer.home_mm], rng.uniform(10, 210, (300, 2))])
    swings = 0.12 * np.sin(points[:, :1] * (2 * np.pi / 34.6)) * [1.0, 0.0]
    trace = Trace(points, points + swings + rng.normal(0, 0.03, points.shape), homed=True)
    examination = examine(trace, printer, rng=rng)
    assert examination.saved.findings[0].startswith("X idler or belt uneven, every 34.")
    assert any("An idler is off its centre" in one.meaning for one in examination.advice)
    assert not any(one.title.startswith("X pulley") for one in examination.advice)


def test_an_idler_of_nearly_the_pulleys_size_is_no_elastic_belt(rng: np.random.Generator) -> None:
    phase_rad = 0.5 * np.pi
    points, others = (np.vstack([[ENDER3.home_mm], rng.uniform(10, 200, (count, 2))]) for count in (800, 1000))
    twin = Twin.of(Corruption((Drive(pulley=EccentricBore(0.1, 1.0)), Drive())), ENDER3)

    def printed(at: np.ndarray) -> np.ndarray:
        angle = (at - at[0]) * (TURN_RAD / 38.5) + phase_rad
        return twin.follow(at) + 0.2 * (np.sin(angle) - np.sin(phase_rad)) * [1.0, 0.0]

    trace = Trace(points, printed(points) + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, ENDER3, rng=rng)
    assert box.periods_mm == (40.0, 40.0)
    assert box.drives[0].structure.second_mm == pytest.approx(38.5, abs=0.8)
    assert not box.drives[0].structure.elastic
    off = (Twin(box.mechanism).follow(others) - printed(others))[1:]
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.01


def test_the_pulley_in_the_picture_is_the_pulley_in_the_machine(examined: Examination) -> None:
    x, y = examined.portraits
    r0 = radius_mm(40.0)
    # about its own centre the eccentric pulley is round; that centre lies 0.8 mm from the shaft
    centre = (x.outline_mm.max(axis=0) + x.outline_mm.min(axis=0)) / 2
    assert np.hypot(*centre) == pytest.approx(0.8, abs=0.02)
    assert np.abs(np.hypot(*(x.outline_mm - centre).T) - r0).max() < 0.05
    reach = np.hypot(*y.outline_mm.T)
    assert (reach.max(), reach.min()) == (pytest.approx(6.6, abs=0.03), pytest.approx(6.1, abs=0.03))


def test_most_points_lie_in_the_band(examined: Examination, rng: np.random.Generator) -> None:
    """As many on a scan, whose scale is open: a picture shows no scale error, and says so."""
    scan = examine(replace(probe_trace(BROKEN, ENDER3), instrument=FLATBED), ENDER3, rng=rng)
    for one in (*examined.portraits, *scan.portraits):
        band = 2 * np.hypot(one.sd_mm, one.noise_mm)
        off = np.empty(len(one.point_side))
        for side in (0, 1):
            at = one.point_side == side
            curve, half = (np.interp(one.point_motor_mm[at], one.motor_mm, row[side]) for row in (one.error_mm, band))
            off[at] = np.abs(one.point_error_mm[at] - curve) / half
        assert len(off) > 200
        assert 0.92 < np.mean(off < 1) < 0.985
        scaled = replace(one, scale_percent=-0.4)
        caption, label = (drawn := pictures(replace(scan, portraits=(scaled, one)), str)[0]).caption, drawn.figures[0]
        assert caption.endswith(
            "Of 100 points, about 95 lie within the bands. The scale error of −0.40 % is not drawn."
        )
        assert label.axes[0].get_ylabel() == "printed − commanded, without scale [mm]"


def test_a_part_gets_a_report_too(folder: Path, tmp_path: Path, rng: np.random.Generator) -> None:
    """Its walls show one direction only; each is drawn across itself, and at the motor along which it faces."""
    dots = probe_trace(BROKEN, ENDER3)
    walls = np.flatnonzero(dots.measured_rows)[::2]
    normal = np.full((len(dots), 2), np.nan)
    normal[walls] = rng.permutation(np.resize([[1, 0], [0, 1], [-1, 0], [0, -1], [0.6, 0.8]], (len(walls), 2)))
    middle, (c, s) = np.array(ENDER3.middle_mm[:2]), (np.cos(0.01), np.sin(0.01))
    seen = (dots.measured_mm - middle) @ [[c, s], [-s, c]] + middle  # the part lay turned: no error of the printer
    out_mm = np.sum(normal * (seen - dots.commanded_mm), axis=1) + 0.05
    unread = np.full((len(dots), 2), np.nan)
    trace = replace(dots, measured_mm=unread, normal=normal, offset_mm=out_mm, placed=False, instrument=FLATBED)
    part = examine(trace, ENDER3, part=folder / "part <1>.gcode", rng=rng)
    assert {"X pulley is off its centre", "Y pulley is oval", "X belt has play"} <= {one.title for one in part.advice}
    assert all(len(one.point_side) > 50 for one in part.portraits)
    shown = {tuple(place): way for place, way in zip(dots.commanded_mm[walls], normal[walls], strict=True)}
    ways = np.array([shown[tuple(place)] for place in part.places_mm])
    for arrows in (part.before_mm, part.after_mm):
        assert np.abs(arrows[:, 0] * ways[:, 1] - arrows[:, 1] * ways[:, 0]).max() < 1e-9
    before, after = (np.sqrt(np.mean(np.sum(each**2, axis=1))) for each in (part.before_mm, part.after_mm))
    assert 0.2 < before < 0.5  # a turn of 0.01 rad moves them by more
    assert after == pytest.approx(0.02, abs=0.003)
    assert part.prediction is not None
    write_examination(tmp_path / "part.pdf", part)
    write_examination(tmp_path / "teil.html", part, language="de")
    page = html.unescape((tmp_path / "teil.html").read_text())
    assert "<p>part <1>.gcode, korrigiert: Unsicherheitsbudget" in page
    combined = f"{part.prediction.after.combined_mm:.4f}".replace(".", ",")
    assert f"<td>kombiniert</td><td></td><td>{combined}</td>" in page
    assert "(Filament ohne Namen)" in page
    assert "Eine Wand zeigt nur den Fehler quer zu ihr" in page


def test_a_healthy_printer_needs_nothing(rng: np.random.Generator, tmp_path: Path) -> None:
    examination = examine(probe_trace(HEALTHY, ENDER3), ENDER3, rng=rng)
    assert examination.advice == ()
    assert examination.title == "This printer is healthy"
    assert "healthy" in examination.headline
    for one in pictures(examination, str):  # no star is drawn of a round pulley, and its noise not twice
        assert len(one.figures) == 1
    noted = replace(
        examination, misfit=(say("note", "everything is shifted by (+0.57, -1.29) mm from the home position"),)
    )
    assert (noted.title, noted.headline) == (examination.title, examination.headline)
    grave = replace(examination, misfit=(say("note", "of little"), say("refusal", "the model leaves 0.3 mm")))
    assert summary(grave).splitlines()[1:3] == ["refusal: the model leaves 0.3 mm", "note: of little"]
    write_examination(tmp_path / "grave.html", grave)
    page = (tmp_path / "grave.html").read_text()
    assert 0 < page.index("the model leaves 0.3 mm") < page.index("Still open") < page.index("of little")
    warned = replace(examination, misfit=(say("warning", "Y was suddenly off"),))
    assert warned.title == "Faults of this printer"
    assert warned.headline.startswith("Error before mending: 0.0")
    assert standard_rows(examination)[1][2:] == ("0.000", "0.000")
    write_examination(tmp_path / "healthy.html", examination)  # as in the PDF: no table of noughts
    page = (tmp_path / "healthy.html").read_text()
    assert say("standard-nothing-known") in page
    assert "reversal error B" not in page


def test_waves_are_drawn_as_they_act(rng: np.random.Generator) -> None:
    """A small wave that comes with the motor's turn is the pulley's, on a scan as in a table; the rest is no wave."""
    slight = Corruption((Drive(pulley=EccentricBore(0.007)), Drive(pulley=EccentricBore(0.1))))
    exact = probe_trace(slight, ENDER3, noise_mm=0.005)
    for trace in (replace(exact, instrument=FLATBED, placed=False), replace(exact, instrument=Instrument())):
        portraits = examine(trace, ENDER3, rng=rng).portraits
        waves = [np.ptp(one.error_mm[0] - one.level(one.motor_mm)) for one in portraits]
        assert waves == [pytest.approx(0.014, abs=0.003), pytest.approx(0.2, abs=0.01)]


@pytest.mark.parametrize("layers", [1, 2])
def test_a_chart_over_layers_needs_two(examined: Examination, layers: int, tmp_path: Path) -> None:
    assert examined.prediction is not None
    prediction = replace(examined.prediction, layers=examined.prediction.layers[:1] * layers)
    write_examination(tmp_path / "report.html", replace(examined, prediction=prediction))
    assert ("expected error of each layer" in (tmp_path / "report.html").read_text()) == (layers > 1)


def test_one_self_contained_file(folder: Path, examined: Examination, tmp_path: Path) -> None:
    for name in ("report.html", "report.pdf"):
        write_examination(tmp_path / name, examined)
    asked = ["diagnose", folder / "trace.csv", "--printer", "ender3", "--for", folder / "part <1>.gcode"]
    result = run(*asked, "--report", tmp_path / "again.html")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "again.html").read_bytes() == (tmp_path / "report.html").read_bytes()
    assert "Repair soon: X pulley is off its centre" in result.output
    assert "mended" in result.output
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 7  # two motors and their pulleys, the bed twice, a circle
    assert "reversal error B" in page
    assert "expanded, k = 2" in page
    assert "RMS error of nine prints in ten" in page
    assert "<script" not in page
    assert "http" not in page
    assert "part &lt;1&gt;.gcode" in page
    pdf = (tmp_path / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert 3 <= pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") <= 4


def test_a_report_in_german_has_no_english_sentence(examined: Examination, tmp_path: Path) -> None:
    write_examination(tmp_path / "bericht.html", examined, language="de")
    page = html.unescape((tmp_path / "bericht.html").read_text())
    assert '<html lang="de">' in page
    assert "Was zu tun ist" in page
    assert "Wand" not in page  # dots have none
    assert re.search(r"<td>\d,\d{3}</td>", page)
    english = {
        texts[0] for texts in catalogue().values() if texts[0] != texts[1] and re.match(r"[\w ,]{12,}$", texts[0])
    }
    assert len(english) > 500
    assert not [each for each in english if each in page]
    pictures = [base64.b64decode(each).decode() for each in re.findall(r"svg\+xml;base64,([^\"]+)", page)]
    assert any("vorwärts" in each for each in pictures)
    assert not any("moving forwards" in each for each in pictures)


def test_bad_input_ends_in_one_line(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.gcode").write_bytes(b"")
    asked = ["diagnose", folder / "trace.csv", "--printer", "ender3", "--report"]
    cases: list[tuple[type[Exception], list[object]]] = [
        (InputError, [*asked, tmp_path / "report.txt"]),
        (GcodeError, [*asked, tmp_path / "r.html", "--for", tmp_path / "empty.gcode"]),
        (TraceError, ["diagnose", tmp_path / "none.csv", "--printer", "ender3", "--report", tmp_path / "r.html"]),
    ]
    for kind, arguments in cases:
        error = run(*arguments).exception
        assert isinstance(error, kind)
        assert "\n" not in str(error)
    assert not (tmp_path / "r.html").exists()


KINDS = (
    "scale harmonic-1 harmonic-7 play loose-belt play-by-angle friction elastic ripple drift offset skew bow jump "
    "period-31.4 new"
)


def test_what_needs_no_repair_asks_for_none() -> None:
    for kind in ("backlash", "wobble", "loose-belt", "play-by-angle", "friction", "drift", "elastic", "harmonic-1"):
        small = advise(NamedFault("x", kind, 0.03, 0.001, "mm", "words"))
        assert small.urgency == "software"
        assert small.repair.startswith("Nothing")
        assert not advise(NamedFault("x", kind, 0.3, 0.001, "mm", "words")).repair.startswith("Nothing")


@pytest.mark.parametrize("switch", ["unknown", "phase"])
def test_a_report_says_of_ripple_what_mending_does(switch: Switch) -> None:
    printer = replace(ENDER3, homing=Homing(switch))
    broken = corruption_of(["teeth:on=x,period_mm=2,size_mm=0.035,phase_rad=1"])
    examination = examine(probe_trace(broken, printer), printer, rng=np.random.default_rng(0))
    (advice,) = examination.advice
    table = examination.saved.mechanism.transmissions[0]
    is_mended = bool(np.ptp(table.lower_mm - table.motor_mm) > 0.035)
    assert is_mended == (switch == "phase")
    assert advice.urgency == ("software" if is_mended else "left")
    assert ("leaves it" in advice.software) != is_mended
    assert ("corrects" in advice.software) == is_mended
    assert f"1 {'left to the software' if is_mended else 'not mended'}" in examination.headline


@pytest.mark.parametrize("kind", KINDS.split())
def test_every_kind_of_fault_has_words(kind: str) -> None:
    advice = advise(NamedFault("x", kind, -0.7, 0.01, "mm", "words"))
    assert advice.title
    assert advice.repair.endswith(".")
    assert advice.sure.startswith("certain")
    assert advise(NamedFault("x", kind, 0.7, 0.0, "mm", "words"), corexy=True).sure.startswith("seen")


def test_every_kind_of_fault_has_words_for_its_owner() -> None:
    for kind in ("warp", "drift", "elastic", "bow", "friction", "ripple", "jump", "play-by-angle", "loose-belt"):
        advice = advise(NamedFault("x", kind, 0.3, 0.01, "mm", "words"))
        assert kind not in advice.title
        assert advice.repair != "Have a look."
