"""Printers: presets, a user's own file, kinematics."""

from pathlib import Path

import numpy as np
import pytest

import printmend
from printmend.corruption import HEALTHY
from printmend.errors import ConfigError, TraceError
from printmend.measure import write_trace
from printmend.printer import Printer, preset_names, read_printer
from printmend.printer.toml import parse_printer, preset_text


def test_presets_are_the_documented_machines() -> None:
    assert {"corexy", "ender3", "ender5"} <= set(preset_names())
    ender5, ender3, corexy = (read_printer(name) for name in ("ender5", "ender3", "corexy"))
    assert ender5.bed_steps == (1100, 1100)
    assert ender5.home_mm == (220.0, 220.0)
    assert (ender5.z.max_mm, ender5.mm_per_step) == (300.0, (0.2, 0.2))
    assert ender3.home_mm == (0.0, 0.0)
    assert corexy.kinematics == "corexy"
    assert corexy.bed_steps == (1500, 1500)


def test_motor_coordinates_round_trip(printer: Printer, rng: np.random.Generator) -> None:
    xy = rng.uniform(0, 200, (50, 2))
    np.testing.assert_allclose(printer.from_motor(printer.to_motor(xy)), xy, atol=1e-12)
    for motor in range(2):
        low, high = printer.motor_range_mm(motor)
        assert (printer.to_motor(xy)[:, motor] >= low).all()
        assert (printer.to_motor(xy)[:, motor] <= high).all()


def test_own_file_reads_like_a_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(preset_text("ender3"))
    assert read_printer(path) == read_printer("ender3")


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("microsteps = 16", "microstep = 16", "microstep"),
        ("microsteps = 16", "microsteps = 0", "microsteps"),
        ("mm_per_turn = 40.0", "mm_per_turn = nan", "mm_per_turn"),
        ("mm_per_turn = 40.0", "mm_per_turn = -40.0", "mm_per_turn"),
        ("mm_per_turn = 40.0", "mm_per_turn = 1e-9", "mm_per_turn"),
        ("home_mm = 0.0", "home_mm = 1e300", "home_mm"),
        ("max_mm = 220.0", "max_mm = -5.0", "max_mm"),
        ('home_side = "min"', 'home_side = "left"', "home_side"),
        ('kinematics = "cartesian"', 'kinematics = "delta"', "kinematics"),
        ("[y]", "[q]", "q"),
        ("[x]", "[x", "TOML"),
        ("[x]", "[limits]\naccel_mm_s2 = 0\n[x]", "accel_mm_s2"),
        ("[x]", "[limits]\nspeed_mm_s = true\n[x]", "speed_mm_s"),
        ("[x]", "[limits]\njerk = 8\n[x]", "jerk"),
        ("[x]", "limits = 3\n[x]", "limits"),
    ],
)
def test_a_wrong_key_is_named(tmp_path: Path, old: str, new: str, named: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(preset_text("ender3").replace(old, new, 1))
    with pytest.raises(ConfigError, match=named):
        read_printer(path)


@pytest.mark.parametrize("name", ["Ender3", "Ender 3", "ENDER-3"])
def test_capitals_spaces_and_hyphens_of_a_preset_do_not_matter(name: str) -> None:
    assert read_printer(name) == read_printer("ender3")


def test_python_takes_a_printers_name_for_it_and_a_tables_path(tmp_path: Path) -> None:
    printer = read_printer("ender3")
    assert printmend.Twin.of(HEALTHY, "ender3").printer == printer
    named, plan = (printmend.design_probe(each, size_mm=60) for each in ("ender3", printer))
    np.testing.assert_array_equal(named.waypoints_mm, plan.waypoints_mm)
    few = printmend.Trace(np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(TraceError):
        printmend.learn_model(few, "ender3")
    with pytest.raises(ConfigError, match="ender33"):
        printmend.learn_model(few, "ender33")
    write_trace(tmp_path / "s.csv", few)
    for path in (tmp_path / "s.csv", str(tmp_path / "s.csv")):
        with pytest.raises(TraceError, match=r"s\.csv: .* found 3 in 3 rows"):
            printmend.learn_model(path, "ender3")


@pytest.mark.parametrize("name", ["Creality CR-10S", "cr10"])
def test_a_printer_by_another_name_is_guessed(name: str) -> None:
    with pytest.raises(ConfigError, match=r"did you mean cr10s\?"):
        read_printer(name)


@pytest.mark.parametrize("end", [r"\n", r"\r", r"\u2028"])
def test_a_name_is_one_line_since_it_stands_in_comments_of_gcode(end: str) -> None:
    text = preset_text("ender3").replace('name = "', f'name = "a{end}M104 S300 ', 1)
    with pytest.raises(ConfigError, match="one line"):
        parse_printer(text, subject="mine.toml")
