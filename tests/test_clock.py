"""The clock: laws of motion, the slow planners, and what a file may say of its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.clock import FIRMWARES, Limits, klipper, limits_of, start_clock
from printmend.gcode import kernels as k
from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.read import read_gcode
from printmend.gcode.write import follow
from tests import naive_clock

OURS = {"klipper": klipper(200.0, 2000.0, 10.0, 100.0)} | {
    name: Limits(name, print_mm_s2=2000.0, travel_mm_s2=1500.0, retract_mm_s2=800.0)
    for name in FIRMWARES
    if name != "klipper"
}
HEAD = "G28\nG90\nM83\n"


def unchanged(records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
    return len(records), np.zeros(len(records) + 1, np.int64), np.empty(0, k.PIECE)


def taken_s(text: str, limits: Limits, flavour: Flavour = Flavour.UNKNOWN, lines_at_once: int = 1 << 20) -> float:
    """Let the clock run over a text, so many lines at once."""
    clock = start_clock(limits)
    lines = text.splitlines(keepends=True)
    chunks = ["".join(lines[i : i + lines_at_once]) for i in range(0, len(lines), lines_at_once)]
    follow(
        (np.frombuffer(chunk.encode(), np.uint8) for chunk in chunks), initial_state(flavour=flavour), unchanged,
        look=lambda planned: clock.advance(planned, mended=False),
    )  # fmt: skip
    clock.finish()
    return clock.seconds


def moves_of(text: str) -> list[naive_clock.Move]:
    moves = read_gcode(text.encode()).moves
    ways = np.column_stack([moves.end_mm - moves.start_mm, moves.extrusion_mm])
    return [
        naive_clock.Move((x, y, z, e), feed or 25.0)
        for (x, y, z, e), feed in zip(ways.tolist(), moves.feed_mm_s.tolist(), strict=True)
    ]


def walk(seed: int, moves: int, step_mm: float = 5.0) -> str:
    """A path of printing moves, travels, lifts and retractions."""
    rng = np.random.default_rng(seed)
    x, y, z, text = 100.0, 100.0, 0.2, HEAD + "G1 X100 Y100 F6000\n"
    direction = 0.0
    for _ in range(moves):
        kind = rng.choice(["print", "print", "print", "travel", "lift", "retract", "both"])
        direction += rng.choice([0.0, 0.02, 0.3, 1.6, 3.1]) * rng.choice([-1, 1])
        length = rng.exponential(step_mm)
        x, y = x + length * np.cos(direction), y + length * np.sin(direction)
        feed = f" F{rng.choice([600, 1800, 6000, 18000])}" if rng.random() < 0.2 else ""
        if kind == "print":
            text += f"G1 X{x:.3f} Y{y:.3f} E{0.04 * length:.5f}{feed}\n"
        elif kind == "travel":
            text += f"G0 X{x:.3f} Y{y:.3f}{feed}\n"
        elif kind == "both":
            text += f"G1 X{x:.3f} Y{y:.3f} E-{0.02 * length:.5f}{feed}\n"
        elif kind == "lift":
            z += 0.2
            text += f"G1 Z{z:.3f}{feed}\n"
        else:
            text += f"G1 E{rng.choice([-1.0, 1.0])}{feed}\n"
    return text


@pytest.mark.parametrize("firmware", FIRMWARES)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("step_mm", [0.3, 5.0])
def test_the_clock_agrees_with_the_slow_planner(firmware: str, seed: int, step_mm: float) -> None:
    text, limits = walk(seed, 400, step_mm), OURS[firmware]
    assert taken_s(text, limits) == pytest.approx(naive_clock.seconds(moves_of(text), limits), rel=1e-7)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_long_file_in_pieces_takes_as_long_as_at_once(firmware: str) -> None:
    """Where the queue is full, what is yet to come has no part in what goes by."""
    text, limits = walk(7, 6000, 0.4), OURS[firmware]
    wanted = naive_clock.seconds(moves_of(text), limits)
    assert taken_s(text, limits) == pytest.approx(wanted, rel=1e-7)
    assert taken_s(text, limits, lines_at_once=313) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_straight_way_is_not_longer_in_pieces(firmware: str) -> None:
    limits = replace(OURS[firmware], cruise_ratio=0.0, jump_mm_s=(0.05,) * 4)
    whole = taken_s(HEAD + "G1 X0 F6000\nG1 X100 E10 F3600\n", limits)
    pieces = "".join(f"G1 X{x} E0.1\n" for x in range(1, 101))
    start = taken_s(HEAD + "G1 X0 F6000\n", limits)
    assert taken_s(HEAD + "G1 X0 F6000\nG1 F3600\n" + pieces, limits) == pytest.approx(whole, rel=1e-3)
    accel, speed = 2000.0, 60.0
    assert whole - start == pytest.approx(100 / speed + speed / accel, rel=2e-3)


def test_klipper_takes_a_right_angle_at_the_square_corner_velocity() -> None:
    limits = klipper(100.0, 1000.0, 10.0, 100.0)
    there, back = HEAD + "G1 X100 F3000\n", HEAD + "G1 X100 F3000\nG1 Y100\n"
    v, corner, a = 50.0, 5.0, 1000.0
    one = (v - corner) / a + v / a + (100 - (2 * v**2 - corner**2) / (2 * a)) / v
    assert taken_s(back, limits) == pytest.approx(2 * one, rel=1e-6)
    assert taken_s(there, limits) == pytest.approx(100 / v + v / a, rel=1e-6)


def test_a_small_queue_cannot_go_fast_over_short_moves() -> None:
    """Marlin has to be able to stop within its 16 blocks: 15 of 0.1 mm at 500 mm/s² are at most √(2 · 500 · 1.5)."""
    text = HEAD + "".join(f"G1 X{0.1 * x:.1f} E0.01 F9000\n" for x in range(1, 1001))
    slow = Limits("marlin", print_mm_s2=500.0)
    assert taken_s(text, slow) > 0.95 * 100 / np.sqrt(2 * 500 * 1.6)
    assert taken_s(text, replace(klipper(300.0, 500.0, 10.0, 100.0), cruise_ratio=0.0)) < 1.5


def test_an_arc_takes_as_long_as_its_way() -> None:
    for plane, words in (("G17", "X20 Y0 I10 J0"), ("G18", "X20 Z0 I10 K0"), ("G19", "Y20 Z0 J10 K0")):
        text = HEAD + f"G1 X0 Y0 Z0 F600\n{plane}\nG2 {words} F60\n"
        limits = replace(OURS["klipper"], arc_mm=0.1)
        assert taken_s(text, limits) == pytest.approx(np.pi * 10, rel=1e-2)


SLOW = HEAD + "G1 X0 F6000\n{}\nG1 X100 F12000\n"


@pytest.mark.parametrize(
    ("line", "flavour", "firmware", "wanted_s"),
    [
        ("G4 P1500", Flavour.UNKNOWN, "marlin", 1.5),
        ("G4 S2 P500", Flavour.UNKNOWN, "marlin", 2.5),
        ("G4 S2 P500", Flavour.KLIPPER, "klipper", 0.5),
        ("M73 P10 R99", Flavour.UNKNOWN, "marlin", 0.0),
        ("M117 G4 P1000", Flavour.UNKNOWN, "marlin", 0.0),
    ],
)
def test_what_waits_and_what_does_not(line: str, flavour: Flavour, firmware: str, wanted_s: float) -> None:
    plain = taken_s(SLOW.format(""), OURS[firmware], flavour)
    assert taken_s(SLOW.format(line), OURS[firmware], flavour) == pytest.approx(plain + wanted_s, abs=1e-9)


@pytest.mark.parametrize(
    ("line", "firmware", "speed", "accel"),
    [
        ("M204 P500 T400", "marlin", 200, 400),
        ("M204 S600", "marlin", 200, 600),
        ("M203 X50", "marlin", 50, 1500),
        ("M203 X3000", "rrf", 50, 1500),
        ("M201 X500", "marlin", 200, 500),
        ("M220 S50", "marlin", 100, 1500),
        ("M220 S50", "klipper", 100, 2000),
        ("M204 P500 T400", "klipper", 200, 400),
        ("M204 S700", "klipper", 200, 700),
        ("M201 X500", "klipper", 200, 2000),
        ("SET_VELOCITY_LIMIT VELOCITY=120 ACCEL=900 SQUARE_CORNER_VELOCITY=7 ; slower", "klipper", 120, 900),
        ("SET_VELOCITY_LIMIT ACCEL=900", "marlin", 200, 1500),
    ],
)
def test_a_file_sets_limits_as_its_firmware_reads_them(line: str, firmware: str, speed: float, accel: float) -> None:
    flat = {"cruise_ratio": 0.0, "jump_mm_s": (0.05,) * 4}
    limits = replace(OURS[firmware], **flat)  # type: ignore[arg-type]
    plain = taken_s(HEAD + "G1 X0 F6000\n", limits)
    wanted_s = 100 / speed + speed / accel
    assert taken_s(SLOW.format(line), limits) - plain == pytest.approx(wanted_s, rel=2e-3)


def test_the_slicers_settings_are_the_limits() -> None:
    block = (
        b"; machine_max_acceleration_extruding = 1250,1250\n; machine_max_acceleration_retracting = 1300\n"
        b"; machine_max_acceleration_travel = 1400\n; machine_max_acceleration_x = 9000\n"
        b"; machine_max_acceleration_y = 8000\n; machine_max_feedrate_x = 200,100\n; machine_max_feedrate_z = 12\n"
        b"; machine_max_jerk_x = 8\n; machine_max_jerk_e = 0\n"
    )
    limits = limits_of(Flavour.MARLIN2, (b"G28\n", block))
    assert (limits.firmware, limits.said) == ("marlin", "the slicer's settings")
    assert (limits.print_mm_s2, limits.retract_mm_s2, limits.travel_mm_s2) == (1250, 1300, 1400)
    assert limits.speed_mm_s[:3] == (200, 300, 12)
    assert limits.accel_mm_s2[:2] == (9000, 8000)
    assert limits.jump_mm_s == (8.0, 10.0, 0.3, 5.0), "nothing that is zero is a limit"
    assert limits_of(Flavour.MARLIN2, (block + b"; machine_limits_usage = ignore\n",)) == Limits("marlin")
    assert limits_of(Flavour.KLIPPER, ()).firmware == "klipper"
    assert limits_of(Flavour.UNKNOWN, (), "klipper").firmware == "klipper"
    bent = limits_of(Flavour.MARLIN2, (b"; machine_max_junction_deviation = 0.05\n",))
    assert (bent.firmware, bent.deviation_mm) == ("marlin, by junction deviation", 0.05)


@given(st.lists(st.sampled_from(
    ["G1 X5 E1", "G1 X5 E-1", "G28", "G2 X9 I2", "G1 X1e9 F1", "G92 X0", "M220 S0", "M203 X0", "M204 S-5", "M201 Y1e9",
     "SET_VELOCITY_LIMIT ACCEL=0", "SET_VELOCITY_LIMIT MINIMUM_CRUISE_RATIO=5", "G4 P-4", "G4 S1e3", "M205 X0 J9", "T1",
     "G1 F0", "G1 Z9", "M73 P5", "PAUSE", "G91", "G10", "G20", "G1 Xnan", "G5 X1 Y1 I1 J1 P1 Q1"]), max_size=30),
    st.sampled_from(FIRMWARES))  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_time_never_runs_back_and_is_a_number(lines: list[str], firmware: str) -> None:
    first = "\n".join(lines[: len(lines) // 2]) + "\nG4 P1\n"
    shorter = taken_s(first, OURS[firmware])
    whole = taken_s(first + "\n".join(lines[len(lines) // 2 :]), OURS[firmware])
    assert np.isfinite(whole)
    assert 0.0 <= shorter <= whole + 1e-9
