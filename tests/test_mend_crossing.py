"""Crossings that speed up more than the file does: only they do, and everything else stays as it was."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.clock import klipper, start_stopwatch
from printmend.clock.clock import start_clock
from printmend.gcode import kernels as k
from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.write import follow, rewrite
from printmend.machine import Mechanism
from printmend.model import exact_model, write_model
from printmend.plan import start
from printmend.printer import MotionLimits
from tests.mending import ENDER3, PLAY, START

OWN, CEILING = 1000.0, 12000.0
ZIGZAG = START + b"".join(b"G1 X%.1f Y%.1f E.2 F3000\n" % (60 + 20 * (i % 2), 60 + 0.6 * i) for i in range(60))
ASLANT = START + b"".join(
    b"G1 X%.1f Y%.1f E.2 F3000\n" % (60 + 9 * (i % 2), 60 + 9 * (i % 2) + 0.6 * i) for i in range(60)
)


def hurried(
    text: bytes, crossing_mm_s2: float, flavour: Flavour = Flavour.KLIPPER, mechanism: Mechanism = PLAY
) -> bytes:
    planner = start(mechanism)
    planner.begin(crossing_mm_s2=crossing_mm_s2)
    chunk = np.frombuffer(text, np.uint8)
    return b"".join(map(bytes, rewrite([chunk], initial_state(mechanism.printer, flavour), planner.plan)))


def told(letter: bytes) -> bytes:
    return START.replace(b"G28\n", b"G28\nM204 %b1000\n" % letter)


def lines_with_accel(text: bytes) -> list[tuple[float, bytes]]:
    """Each line that moves, with the acceleration in force."""
    accel, found = 0.0, []
    for line in text.splitlines():
        if (said := re.match(rb"M204 [PS](\d+)", line)) is not None:
            accel = float(said[1])
        elif line.startswith((b"G0", b"G1")):
            found.append((accel, line))
    return found


@pytest.mark.parametrize(
    ("letter", "flavour"), [(b"S", Flavour.KLIPPER), (b"S", Flavour.MARLIN2), (b"P", Flavour.MARLIN2)]
)
@pytest.mark.parametrize("body", [ZIGZAG, ASLANT])
def test_only_accelerations_are_added(letter: bytes, flavour: Flavour, body: bytes) -> None:
    text = told(letter) + body.removeprefix(START)
    plain, fast = hurried(text, 0.0, flavour), hurried(text, CEILING, flavour)
    head = b"M204 " + letter
    assert fast.count(head) > 3
    first, rest = fast.split(head + b"1000\n", 1)
    kept = b"".join(line for line in rest.splitlines(keepends=True) if not line.startswith(b"M204"))
    assert first + head + b"1000\n" + kept == plain


def test_what_drives_a_belt_keeps_the_acceleration_of_the_file() -> None:
    fast = lines_with_accel(hurried(told(b"S") + ZIGZAG.removeprefix(START), CEILING))
    assert max(accel for accel, _ in fast) > 5 * OWN
    x = y = np.nan
    for accel, line in fast:
        words = {word[:1]: float(word[1:]) for word in line.split()[1:]}
        way = np.array([words.get(b"X", x) - x, words.get(b"Y", y) - y])
        x, y = words.get(b"X", x), words.get(b"Y", y)
        if accel > OWN:  # a crossing is as short as the slack, and Y, which turns nowhere, goes no faster
            assert abs(way[0]) < 0.5
            assert accel <= CEILING
            assert accel * abs(way[1]) <= 1.05 * OWN * np.hypot(*way) + accel * 0.001
    assert fast[-1][0] == OWN or fast[-2][0] == OWN


def test_the_file_ends_with_its_own_acceleration() -> None:
    said = re.findall(rb"M204 S(\d+)", hurried(told(b"S") + ZIGZAG.removeprefix(START), CEILING))
    assert said[-1] == b"1000"


@pytest.mark.parametrize(
    "text",
    [
        ZIGZAG,  # nobody says what to go back to
        told(b"S").replace(b"1000", b"20000") + ZIGZAG.removeprefix(START),  # faster than the ceiling
        b"".join(b"N1 %b\n" % line for line in (told(b"S") + ZIGZAG.removeprefix(START)).splitlines()),
        told(b"P") + ZIGZAG.removeprefix(START),  # Klipper does not know P without T
    ],
)  # fmt: skip
def test_no_acceleration_is_told_where_that_may_not_be(text: bytes) -> None:
    assert hurried(text, CEILING) == hurried(text, 0.0)


def test_the_clock_of_the_plan_is_that_of_the_text() -> None:
    limits = klipper(300.0, 3000.0, 25.0, 300.0)
    text = told(b"S") + ZIGZAG.removeprefix(START)
    seconds = []
    for crossing_mm_s2 in (0.0, CEILING):
        planner, watch = start(PLAY), start_stopwatch(limits)
        planner.begin(crossing_mm_s2=crossing_mm_s2)
        chunk = np.frombuffer(text, np.uint8)
        state = initial_state(PLAY.printer, Flavour.KLIPPER)
        written = b"".join(map(bytes, rewrite([chunk], state, planner.plan, look=watch.watch)))
        watch.finish()
        clock = start_clock(limits)
        follow(
            [np.frombuffer(written, np.uint8)], initial_state(PLAY.printer, Flavour.KLIPPER),
            lambda records, begin: (len(records), np.zeros(len(records) + 1, np.int64), np.empty(0, k.PIECE)),
            look=lambda planned, clock=clock: clock.advance(planned, mended=False),
        )  # fmt: skip
        clock.finish()
        assert clock.seconds == pytest.approx(watch.duration.after_s, rel=1e-4)
        seconds.append(clock.seconds)
    assert seconds[1] < seconds[0]


def test_the_printer_s_file_says_how_fast_and_the_owner_is_told_where_it_cannot_be(tmp_path: Path) -> None:
    source, model, output = tmp_path / "part.gcode", tmp_path / "m.mend.json", tmp_path / "out.gcode"
    source.write_bytes(ZIGZAG)
    limits = MotionLimits(accel_mm_s2=1000.0, crossing_mm_s2=12000.0)
    for given, options in ((limits, []), (MotionLimits(), ["--crossing", "12000"])):
        write_model(model, exact_model(replace(PLAY, printer=replace(ENDER3, limits=given))))
        done = CliRunner().invoke(
            group, ["mend", str(source), "-m", str(model), "-o", str(output), "--overwrite", *options]
        )
        assert done.exit_code == 0, done.output
        assert (b"M204 P12000\n" in output.read_bytes()) is not bool(options)
        assert ("the slack is crossed no faster" in done.output) is bool(options)


@pytest.mark.parametrize(
    "limit", [b"M201 X3500 Y3000.00 Z100 E5000 ;from the slicer\n", b"; machine_max_acceleration_x = 3000,3500\n"]
)
def test_a_crossing_speeds_up_no_more_than_the_file_lets_the_firmware(limit: bytes, tmp_path: Path) -> None:
    source, model, output = tmp_path / "part.gcode", tmp_path / "m.mend.json", tmp_path / "out.gcode"
    write_model(model, exact_model(PLAY))
    for flavour, most in ((b"Marlin", 3000), (b"Klipper", 12000)):
        source.write_bytes(b";FLAVOR:" + flavour + b"\n" + limit + told(b"S") + ZIGZAG.removeprefix(START))
        done = CliRunner().invoke(
            group, ["mend", str(source), "-m", str(model), "-o", str(output), "--overwrite", "--crossing", "12000"]
        )
        assert done.exit_code == 0, done.output
        asked = {accel for accel, _ in lines_with_accel(output.read_bytes())}
        assert OWN < max(asked) == most
        assert "crossed no faster" not in done.output
        assert ("crossed with 3000 mm/s² at most" in done.output) is (most == 3000)
    slow = ["mend", str(source), "-m", str(model), "-o", str(output), "--overwrite", "--crossing", "500"]
    assert f"{OWN:.0f} mm/s², is already as high as requested" in CliRunner().invoke(group, slow).output
