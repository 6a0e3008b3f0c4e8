"""The live transform for Klipper, judged by Klippy: where the plastic lands without any rewriting."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hosts import INTEGRATIONS
from parts import part

from bench_live import compare, drawn
from klippy_bead import ADVANCED, SHAPED, wall_deviation
from klippy_judge import Track, judge_both, wanted_path
from klippy_run import RefusedByPlanner, plan
from printmend.corruption import Corruption, Drive, corruption_toml
from printmend.corruption.transmission import Ripple
from printmend.machine import Frame, healthy_mechanism
from printmend.mend import mend_gcode
from printmend.model.branches import Branches, ScrewSeries, Wave
from printmend.model.model import exact_model, read_model, saved_model, with_screw, write_model
from printmend.plan.inverse import lookup
from printmend.plan.kernels import height
from printmend.plan.kernels import lookup as kernels
from printmend.printer import read_printer
from printmend.provenance import sealed_test_print
from printmend_lab.sampling import sample
from true_printer import TruePrinter

ENDER3, COREXY = read_printer("ender3"), read_printer("corexy")


def extra():
    spec = importlib.util.spec_from_file_location("printmend_live", INTEGRATIONS / "klipper/printmend.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


LIVE = extra()
CASES = [
    ("pulley-play", ENDER3, True), ("pulley-loose", COREXY, True), ("everything", COREXY, True),
    ("screw", ENDER3, True),
]  # fmt: skip


@pytest.mark.parametrize(("family", "printer", "arcs"), CASES, ids=lambda value: getattr(value, "name", str(value)))
def test_it_prints_what_the_mended_file_prints(family: str, printer, arcs: bool, tmp_path: Path) -> None:
    """The same error, no stop more, and the time of the file that was mended offline; limits and fans in their turn."""
    before, mended, after, complaints = compare(drawn(family), printer, tmp_path, arcs=arcs)
    assert not complaints
    assert after.rms_mm < 0.012
    assert before.rms_mm > 3 * after.rms_mm or before.height_max_mm > 10 * after.height_max_mm
    assert after.rms_mm < 1.02 * mended.rms_mm
    assert after.max_mm < mended.max_mm + 0.002
    assert after.height_max_mm < mended.height_max_mm + 0.002
    assert after.stops <= mended.stops
    assert after.corners <= mended.corners
    assert after.job_s < 1.005 * mended.job_s
    assert after.samples == pytest.approx(before.samples, rel=1e-3)


def test_slack_is_crossed_as_fast_as_the_owner_allows(tmp_path: Path) -> None:
    """By the limits of the printer's file, as in a mended file, and back to those of the print after it."""
    times = []
    for crossing in (None, 20_000.0):
        limits = replace(ENDER3.limits, accel_mm_s2=3000.0, crossing_mm_s2=crossing)
        (folder := tmp_path / str(crossing)).mkdir()
        _, mended, live, complaints = compare(drawn("pulley-loose"), replace(ENDER3, limits=limits), folder, arcs=True)
        assert not complaints
        assert live.rms_mm < 1.02 * mended.rms_mm
        assert live.job_s == pytest.approx(mended.job_s, rel=0.005)
        times.append(live.job_s)
    assert times[1] < 0.998 * times[0]


RIPPLES = [(0.0, 0.0), (0.1, 0.2), (0.3, 0.05)]


def test_walls_keep_their_width_where_no_comment_names_them(tmp_path: Path) -> None:
    """As in a file mended with its walls named, and better than in one without: the live transform sees no comments."""
    ripple = Ripple((0.15,), (20.0,), (1.0,))  # every 2 mm
    corruption = Corruption((Drive(ripple), Drive(replace(ripple, phase_rad=(2.5,)))))
    write_model(path := tmp_path / "printer.mend.json", model := exact_model(corruption.lower(ENDER3)))
    head = b"G28\nG90\nM83\nG1 Z0.2 F600\nG1 X100 Y100 F6000\n"
    walls = b"G1 X160 E2.4 F1800\nG1 Y160 E2.4\nG1 X100 E2.4\nG1 Y100 E2.4\n"
    original, true = plan(head + walls, ENDER3, tmp_path / "a"), TruePrinter.of(corruption_toml(corruption), ENDER3)
    uneven = {}
    for name, text in (("unnamed", head + walls), ("named", head + b";TYPE:External perimeter\n" + walls)):
        (source := tmp_path / "part.gcode").write_bytes(text)
        mend_gcode(source, model, output := tmp_path / "mended.gcode", force=True)
        uneven[name] = plan(output.read_bytes(), ENDER3, tmp_path / "b", around=original)
    extras = f"[printmend]\nmodel: {path}\nphase_x: 0\nphase_y: 0\n"
    uneven["live"] = plan(head + walls, ENDER3, tmp_path / "c", around=original, extras=extras)
    wanted = wanted_path(original)
    off = {name: wall_deviation(one, Track(one, ENDER3, true), wanted) for name, one in uneven.items()}
    assert off["live"] < 1.05 * off["named"]
    assert off["live"] < 0.5 * off["unnamed"]


@pytest.mark.parametrize("tolerance_mm", [0.01, 0.003])
@pytest.mark.parametrize(("period_mm", "speed_mm_s"), [(2.0, 50), (0.8, 20), (0.8, 60)])
def test_walls_keep_their_width_with_an_input_shaper(
    period_mm: float, speed_mm_s: int, tolerance_mm: float, tmp_path: Path
) -> None:
    """Two are 25 Hz, of which a shaper of 40 Hz keeps half: twice as much is commanded. The third would need more than
    the acceleration: what it allows is commanded, and the walls are not slowed."""
    ripple = Ripple((0.1,), (period_mm / 0.2,), (1.0,))  # 0.02 mm
    corruption = Corruption((Drive(ripple), Drive(replace(ripple, phase_rad=(2.5,)))))
    write_model(path := tmp_path / "printer.mend.json", exact_model(corruption.lower(ENDER3)))
    walls = "".join(f"G1 X{x} Y{y} E2\n" for x, y in ((160, 100), (160, 160), (100, 160), (100, 100)))
    text = f"G28\nG90\nM83\nG1 Z0.2 F600\nG1 X100 Y100 F6000\nG1 F{60 * speed_mm_s}\n{walls}".encode()
    original, true = plan(text, ENDER3, tmp_path / "a"), TruePrinter.of(corruption_toml(corruption), ENDER3)
    extras = f"{SHAPED}[printmend]\nmodel: {path}\nphase_x: 0\nphase_y: 0\ntolerance: {tolerance_mm}\n"
    live = plan(ADVANCED + text, ENDER3, tmp_path / "b", around=original, extras=extras)
    plain = plan(ADVANCED + text, ENDER3, tmp_path / "c", around=original, extras=SHAPED)
    wanted = wanted_path(original)
    before, after = (wall_deviation(one, Track(one, ENDER3, true), wanted) for one in (plain, live))
    assert before > 0.03
    assert after < (0.01 if speed_mm_s / period_mm < 30 else 1.2 * before)
    ends = [max(times[-1] for times, _ in one.steps.values()) for one in (plain, live)]
    assert ends[1] < 1.05 * ends[0]


@pytest.mark.parametrize("shift_mm", RIPPLES)
def test_a_ripple_stays_locked_where_the_end_stops_scatter(shift_mm: tuple[float, float], tmp_path: Path) -> None:
    """Homing takes the place of the end stop for another one: the motors' phase tells by how much."""
    ripple = Ripple((0.15,), (10.0,), (1.0,))  # 0.03 mm a belt tooth
    corruption = Corruption((Drive(ripple), Drive(replace(ripple, phase_rad=(2.5,)))))
    model = tmp_path / "printer.mend.json"
    write_model(model, exact_model(corruption.lower(ENDER3)))
    x, y = (replace(axis, home_mm=by) for axis, by in zip((ENDER3.x, ENDER3.y), shift_mm, strict=True))
    missed = replace(ENDER3, x=x, y=y)  # where the firmware thinks that the carriage is at home
    text, true = part(1), TruePrinter.of(corruption_toml(corruption), ENDER3)
    original = plan(text, ENDER3, tmp_path / "a")
    left = {}
    for name, phases in (("locked", "phase_x: 0\nphase_y: 0\n"), ("plain", "")):
        extras = f"[printmend]\nmodel: {model}\n{phases}"
        live = plan(text, missed, tmp_path / name, around=original, extras=extras)
        steps = dict(live.steps)
        moves = live.moves.copy()
        for column, (motor, by) in enumerate(zip("xy", shift_mm, strict=True)):
            steps[motor] = (steps[motor][0], steps[motor][1] - by)
            moves[:, [7 + column, 11 + column]] -= by
        _, after, complaints = judge_both(original, replace(live, steps=steps, moves=moves), ENDER3, true, text, text)
        assert not complaints
        left[name] = after.rms_mm
    assert left["locked"] < 0.01
    assert any(shift_mm) == (left["plain"] > 1.5 * left["locked"])


def test_the_phases_are_said_and_kept(tmp_path: Path) -> None:
    model = tmp_path / "printer.mend.json"
    write_model(model, exact_model(sample("play", np.random.default_rng(1), "realistic").lower(ENDER3)))
    extras = f"[printmend]\nmodel: {model}\n"
    x = replace(ENDER3.x, home_mm=0.1)
    plan(b"PRINTMEND_PHASE SAVE=1\nG1 X10 F600\n", replace(ENDER3, x=x), tmp_path, extras=extras)
    log = (tmp_path / "log").read_text(errors="replace")
    assert "phases at zero are x 56/64, y 0/64; kept" in log


def test_what_it_cannot_hold_is_refused_in_words(tmp_path: Path) -> None:
    model = tmp_path / "printer.mend.json"
    lines = f"[printmend]\nmodel: {model}\n"

    def refusal(printer) -> str:
        with pytest.raises(RefusedByPlanner):
            plan(b"G28\nG1 X10 F600\n", printer, tmp_path, extras=lines)
        return (tmp_path / "log").read_text(errors="replace")

    assert "cannot be read" in refusal(ENDER3)
    write_model(model, exact_model(sample("play", np.random.default_rng(1)).lower(ENDER3)))
    assert "not corexy" in refusal(COREXY)
    document = json.loads(model.read_text())
    model.write_text(json.dumps({**document, "noise_mm": 1.0}))
    assert "changed or damaged" in refusal(ENDER3)


def _series(printer) -> Branches:
    """A drive with all that a series can hold."""
    wave = Wave([0.1, 0.2, 0.05], [1, 2], [0.2, 0.05], [0.1, -0.02])
    return Branches(
        printer.x.mm_per_turn, 100.0, (5.0, 200.0), wave, Wave([0.3], [1], [0.05], [0.0]),
        Wave([], [1], [0.02], [0.01]), np.array([0.02, -0.01]), (5.0, 200.0), Wave([], [1], [0.04], [0.0]), 13.7,
    )  # fmt: skip


FRAME = Frame(0.02 * np.ones((2, 10)), 100.0, np.array([[0.0, 90.0, 0.03, 0.0, 0.0, 0.05]]))


@pytest.mark.parametrize("family", ["pulley-loose", "elastic", "screw", "everything", "a series"])
@pytest.mark.parametrize("printer", [ENDER3, COREXY], ids=lambda printer: printer.kinematics)
def test_its_machine_is_the_models(family: str, printer, tmp_path: Path) -> None:
    path = tmp_path / "printer.mend.json"
    if family == "a series":
        series = _series(printer)
        machine = replace(healthy_mechanism(printer), frame=FRAME)
        screw = ScrewSeries(8.0, 0.01, 0.05, np.array([0.03, 0.01, 0.0, 0.01]), np.full((4, 2), 0.04))
        write_model(path, with_screw(saved_model(machine, learner="exact", branches=(series, series)), screw,
                                     findings=(), details={}))  # fmt: skip
    else:
        write_model(path, exact_model(sample(family, np.random.default_rng(2), "realistic").lower(printer)))
    live, wanted = LIVE.planner.Planner(LIVE.read_model(path)), lookup(read_model(path).mechanism)
    head, model = wanted.head, live.model
    assert (model.head.frame_bend, model.head.screw) == (pytest.approx(head.frame_bend), head.screw)
    assert model.head.sample == pytest.approx(head.sample, rel=0.1)
    assert model.head.rise == pytest.approx(head.rise, rel=0.1)
    assert model.head.chords == pytest.approx(list(head.chords), rel=0.1)
    for motor in range(3 if head.screw else 2):
        low, high = printer.motor_range_mm(motor) if motor < 2 else (0.0, printer.z.max_mm)
        for m in np.linspace(low, high, 211):
            for branch in (0, 1):
                for law in ("forward", "backward"):
                    said = getattr(live.look, law)(model, motor, branch, m)
                    assert said == pytest.approx(getattr(kernels, law)(wanted, motor, branch, m), abs=2e-4)
    for x, y in ((3.0, 7.0), (110.0, 200.0)):
        assert live.look.wanted(model, x, y) == pytest.approx(kernels.wanted(wanted, x, y), abs=1e-8)
    for m in (0.3, 17.0) if head.screw else ():
        assert live.height.push(model, m) == pytest.approx(height.push(wanted, m), abs=1e-9)


def test_a_file_of_another_model_or_changed_since_is_not_begun(tmp_path: Path) -> None:
    (cards := tmp_path / "cards").mkdir()
    machine = sample("play", np.random.default_rng(1)).lower(ENDER3)
    other = sample("play", np.random.default_rng(2)).lower(ENDER3)
    write_model(model := tmp_path / "printer.mend.json", exact_model(machine))
    (source := tmp_path / "part.gcode").write_bytes(part(1))
    for name, who in (("own", machine), ("foreign", other)):
        mend_gcode(source, exact_model(who), cards / f"{name}.gcode")
    (cards / "forged.gcode").write_bytes((cards / "own.gcode").read_bytes().replace(b"F1800", b"F1900"))

    says = b"; printmend probe: 1 dots\n" + part(1)
    (cards / "probe.gcode").write_bytes(sealed_test_print(says))
    (cards / "says.gcode").write_bytes(says)

    def said(name: str, *more: str) -> str:
        lines = "\n".join([f"[printmend]\nmodel: {model}", *more, f"[virtual_sdcard]\npath: {cards}\n"])
        plan(f"SDCARD_PRINT_FILE FILENAME={name}.gcode\n".encode(), ENDER3, tmp_path, extras=lines)
        return (tmp_path / "log").read_text(errors="replace")

    with pytest.raises(RefusedByPlanner, match="was mended with model"):
        said("foreign")
    with pytest.raises(RefusedByPlanner, match="was changed after it was mended"):
        said("forged")
    with pytest.raises(RefusedByPlanner, match="says that it is a test print"):
        said("says")
    assert "the file is a test print; moves stay as they are" in said("probe")
    for name, more in (("own", ()), ("foreign", ("if_foreign: print",)), ("forged", ("if_forged: print",))):
        log = said(name, *more)
        assert "the file is mended; moves stay as they are" in log
        assert "mend its original again" not in log


STATUS = "PRINTMEND_STATUS\n"


def test_a_file_that_an_earlier_model_mended_is_stale_and_a_replaced_model_is_said(tmp_path: Path) -> None:
    """Klipper remembers the models that this printer had: by them it tells stale from foreign, and from forged."""
    (cards := tmp_path / "cards").mkdir()
    earlier, later = (exact_model(sample("play", np.random.default_rng(seed)).lower(ENDER3)) for seed in (1, 2))
    model = tmp_path / "config/printer.mend.json"
    model.parent.mkdir()
    (source := tmp_path / "part.gcode").write_bytes(part(1))
    for name, one in (("early", earlier), ("late", later)):
        mend_gcode(source, one, cards / f"{name}.gcode")
    (cards / "forged.gcode").write_bytes((cards / "early.gcode").read_bytes().replace(b"F1800", b"F1900"))
    (cards / "plain.gcode").write_bytes(part(1))

    def said(name: str, *more: str, before: str = "", after: str = "") -> str:
        lines = "\n".join([f"[printmend]\nmodel: {model}", *more, f"[virtual_sdcard]\npath: {cards}\n"])
        text = f"{before}SDCARD_PRINT_FILE FILENAME={name}.gcode\n{after}"
        plan(text.encode(), ENDER3, tmp_path / "run", extras=lines)
        return (tmp_path / "run/log").read_text(errors="replace")

    write_model(model, earlier)
    with pytest.raises(RefusedByPlanner, match=f"was mended with model {later.digest}, and {earlier.digest} is in use"):
        said("late")  # of a model that this printer never had
    log = said("early", after=STATUS)
    assert "the file is mended; moves stay as they are" in log
    assert "file: current" in log
    write_model(model, later)  # learned again
    held = f"early.gcode was mended with model {earlier.digest}, another one of this printer; {later.digest} is in use"
    with pytest.raises(RefusedByPlanner, match=f"{held}; mend its original again, or choose if_stale: print"):
        said("early")
    with pytest.raises(RefusedByPlanner, match="was changed after it was mended"):
        said("forged")
    log = said("early", "if_stale: print", after=STATUS)
    assert "the file is mended; moves stay as they are" in log
    assert "file: stale" in log
    assert "file: unmended" in said("plain", after=STATUS)
    assert "file: current" in said("late", after=STATUS)
    write_model(tmp_path / "config/winter.mend.json", earlier)  # by name, and then overwritten while it is in use
    log = said("early", before="PRINTMEND MODEL=winter\n", after=STATUS)
    assert "file: current" in log
    assert "by now" not in log


def test_it_is_switched_and_takes_a_model_by_name(tmp_path: Path) -> None:
    for name, seed in (("printer", 1), ("winter", 2)):
        machine = sample("screw" if name == "winter" else "pulley-play", np.random.default_rng(seed)).lower(ENDER3)
        write_model(tmp_path / f"{name}.mend.json", exact_model(machine))
    extras = f"[printmend]\nmodel: {tmp_path / 'printer.mend.json'}\nsegment: 0.5\n"

    def said(text: str) -> str:
        plan(text.encode(), ENDER3, tmp_path / "run", extras=extras)
        return (tmp_path / "run/log").read_text(errors="replace")

    switch = "PRINTMEND_STATUS\nG1 X50 Y50 F6000\nPRINTMEND MODEL=winter\nG1 X60 Z1\nPRINTMEND_STATUS\n"
    log = said(switch + "PRINTMEND ENABLE=0\n")
    for wanted in ("model printer.mend.json", "corrects: motor X, motor Y\n", "model winter.mend.json",
                   "corrects: Z screw", "moves are left alone"):  # fmt: skip
        assert wanted in log
    for name in ("autumn", "../printer"):
        with pytest.raises(RefusedByPlanner, match=r"cannot be read|is no name of a model"):
            said(f"PRINTMEND MODEL={name}\n")


def test_a_move_off_the_bed_is_refused_though_it_waited(tmp_path: Path) -> None:
    model = tmp_path / "printer.mend.json"
    write_model(model, exact_model(sample("play", np.random.default_rng(1)).lower(ENDER3)))
    around, extras = plan(part(1), ENDER3, tmp_path / "a"), f"[printmend]\nmodel: {model}\n"
    for after in (b"", b"M400\n", b"G1 Y20\nG1 X20 E1\nG1 X30\n"):
        with pytest.raises(RefusedByPlanner, match="out of range"):
            plan(b"G1 X230 Y10 F6000\n" + after, ENDER3, tmp_path / "b", around=around, extras=extras)


class Move:
    """A planned move, of which nothing is refused."""

    is_kinematic_move, axes_d = False, (0.0,) * 4

    def __init__(self, *given) -> None:
        pass


class Klipper:
    """As much of Klipper as the chain of transforms needs, with a clock of its own."""

    NEVER, command_error = 1e9, ValueError

    def __init__(self) -> None:
        self.place, self.now, self.max_accel, self.made = [0.0] * 4, 0.0, 1000.0, []
        self.timer, self.at, self.handlers = None, self.NEVER, {}

    def get_position(self) -> list[float]:
        return list(self.place)

    def move(self, to: list[float], speed: float) -> None:
        if to[0] > 230:
            raise ValueError("out of range")
        self.place = list(to)
        self.made.append((to[0], self.max_accel))

    def register_lookahead_callback(self, callback) -> None:
        self.made.append(callback)

    def get_last_move_time(self) -> int:
        return len(self.made)

    def register_timer(self, callback):
        self.timer = callback
        return callback

    def update_timer(self, timer, at_s: float) -> None:
        self.at = at_s

    def monotonic(self) -> float:
        return self.now

    def set_move_transform(self, transform, force: bool) -> "Klipper":
        return self

    def lookup_object(self, name: str, *otherwise: None) -> "Klipper | None":
        return otherwise[0] if otherwise else self

    def get_reactor(self) -> "Klipper":
        return self

    def get_start_args(self) -> dict:
        return {}

    def wait(self, seconds: float) -> None:
        self.now += seconds
        if self.at <= self.now:
            self.at = self.timer(self.now)


@pytest.fixture
def chain(tmp_path: Path):
    write_model(path := tmp_path / "printer.mend.json",
                exact_model(sample("play", np.random.default_rng(1)).lower(ENDER3)))  # fmt: skip
    made = LIVE.Printmend.__new__(LIVE.Printmend)
    made.printer = Klipper()
    made.planner = LIVE.planner.Planner(LIVE.read_model(path))
    made.phases, made.shift, made.homed, made.active, made.failed = [None, None], [0.0, 0.0], 7, True, None
    made.handing_on, made.chords = False, None
    made._connect()
    return made


def test_moves_wait_for_their_path_and_no_longer(chain) -> None:
    klipper = chain.printer
    chain.move([10.0, 10.0, 0.2, 0.0], 50.0)
    assert not klipper.made  # the line that follows says on which side the travel has to end
    klipper.max_accel = 500.0
    chain.move([20.0, 10.0, 0.2, 1.0], 50.0)
    klipper.register_lookahead_callback("fan")
    chain.move([20.0, 20.0, 0.2, 2.0], 50.0)
    klipper.max_accel = 2000.0
    assert not klipper.made
    assert chain.get_position() == [20.0, 20.0, 0.2, 2.0]
    chain.move([30.0, 20.0, 0.2, 2.0], 50.0)
    at = klipper.made.index("fan")
    accels = [each[1] for each in klipper.made if each != "fan"]
    assert accels[0] == 1000.0
    assert set(accels[1:]) == {500.0}
    assert klipper.made[at - 1][0] == pytest.approx(20.0, abs=1.5)
    assert len(klipper.made) > at + 1
    assert klipper.max_accel == 2000.0
    count = len(klipper.made)
    klipper.wait(0.05)
    assert len(klipper.made) == count
    klipper.wait(0.06)
    assert len(klipper.made) > count
    chain.move([40.0, 20.0, 0.2, 2.0], 50.0)
    assert klipper.get_last_move_time() > count + 1  # whoever asks has them made first


def test_a_move_that_fails_while_nobody_moves_is_told_to_who_moves_next(chain) -> None:
    chain.move([250.0, 10.0, 0.2, 0.0], 50.0)
    chain.printer.wait(0.2)
    with pytest.raises(ValueError, match="out of range"):
        chain.move([10.0, 10.0, 0.2, 0.0], 50.0)
    chain.move([20.0, 10.0, 0.2, 0.0], 50.0)
    chain.printer.wait(0.2)
    assert chain.printer.place[0] == pytest.approx(20.0, abs=1.5)


def test_a_path_without_an_end_is_begun(chain) -> None:
    """A vase: hundreds of moves, and no travel among them."""
    turns = np.linspace(0, 40 * np.pi, 4000)
    path = np.stack([100 + 30 * np.cos(turns), 100 + 30 * np.sin(turns)], axis=1)
    most = 0
    for i, (x, y) in enumerate(path):
        chain.move([x, y, 0.2, 0.05 * i], 50.0)
        most = max(most, len(chain.planner.waiting))
    assert most <= LIVE.planner.MOST_WAITING
    klipper = chain.printer
    klipper.wait(0.2)
    assert chain.planner.counts.stops == 0
    assert klipper.place[3] == pytest.approx(0.05 * 3999)
    assert len(klipper.made) > 4000


def test_a_model_that_was_replaced_while_klipper_runs_is_said(chain, tmp_path: Path) -> None:
    """In the status, and as a file is loaded, which may be mended with the newer one."""
    model, told, klipper = tmp_path / "printer.mend.json", [], chain.printer
    klipper.respond_info, klipper.reset_last_position = told.append, lambda: None
    chain.fits, chain.folder, chain.chosen = LIVE.Printer.__new__(LIVE.Printer), str(tmp_path), {"foreign": "hold"}
    chain.fits.check = lambda document: None
    chain.ledger, chain.file = LIVE.provenance.Ledger(str(tmp_path / ".printmend")), ""
    chain.tolerance = 0.01
    chain._load(model.name)
    chain.cmd_PRINTMEND_STATUS(klipper)
    before, after = read_model(model).digest, exact_model(sample("play", np.random.default_rng(9)).lower(ENDER3))
    assert f"digest {before}" in told[-1]
    assert "by now" not in told[-1]
    write_model(model, after)
    words = f"printer.mend.json is model {after.digest} by now; RESTART takes it"
    chain.cmd_PRINTMEND_STATUS(klipper)
    assert f"digest {before}\n{words}\n" in told[-1]  # the one before still corrects
    (plain := tmp_path / "plain.gcode").write_bytes(part(1))
    klipper.file_path = lambda: str(plain)
    chain._loaded()
    assert told[-1] == f"printmend: {words}"
    mend_gcode(plain, after, mended := tmp_path / "mended.gcode")
    klipper.file_path = lambda: str(mended)
    with pytest.raises(ValueError, match=f"was mended with model {after.digest}.*print; {words}"):
        chain._loaded()
    model.unlink()
    chain.cmd_PRINTMEND_STATUS(klipper)
    assert "the model that was there is in use" in told[-1]
