"""What `export` writes, read and obeyed as the firmwares document it, on a printer with the fault."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Play, WrongRadius
from printmend.corruption.frame import CrookedFrame
from printmend.export.firmware import EXPORTS
from printmend.machine import Frame, Mechanism
from printmend.printer import Printer, read_printer
from tests import naive_mend

ENDER3, COREXY = read_printer("ender3"), read_printer("corexy")
RADIUS_MM = ENDER3.x.radius_mm
SCALE = Corruption((Drive(pulley=WrongRadius(0.99 * RADIUS_MM)), Drive(pulley=WrongRadius(1.02 * RADIUS_MM))))
SKEW = Corruption(frame=CrookedFrame(skew_deg=0.7))
PLAY = Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.7))))
ALL = Corruption(
    (Drive(pulley=WrongRadius(0.99 * RADIUS_MM), belt=Play(0.4)), Drive(belt=Play(0.7))), CrookedFrame(skew_deg=-0.7)
)
Files = dict[str, str]
Firmware = Callable[[Files, Printer, np.ndarray], np.ndarray]


def words(text: str, command: str) -> dict[str, float]:
    """Return the letters of a command's line; empty without such a line."""
    found = re.search(rf"^{command} (.*?)(;.*)?$", text, re.MULTILINE)
    return {w[0]: float(w[1:]) for w in found[1].split()} if found else {}


def steps_moved(text: str, printer: Printer, bed: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Steps a millimetre, then the backlash's steps while a motor's last move was forwards: in healthy mm."""
    new, lash = words(text, "M92"), words(text, "M425")
    motors = printer.to_motor(bed + offset)
    healthy = np.array([axis.steps_per_turn * axis.microsteps / axis.mm_per_turn for axis in printer.axes[:2]])
    steps = np.empty_like(motors)
    for i, letter in enumerate("XY"):
        forward, last = False, motors[0, i]
        for n, to in enumerate(motors[:, i]):
            forward, last = to > last if to != last else forward, to
            steps[n, i] = (to + (lash.get(letter, 0.0) if forward else 0.0)) * new.get(letter, healthy[i])
    return steps / healthy


def marlin(files: Files, printer: Printer, bed: np.ndarray) -> np.ndarray:
    """M852 I is subtracted: x − I·y."""
    text = files["marlin.gcode"]
    return steps_moved(text, printer, bed, np.outer(-words(text, "M852").get("I", 0.0) * bed[:, 1], [1, 0]))


def rrf(files: Files, printer: Printer, bed: np.ndarray) -> np.ndarray:
    """M556 is added: x + X/S·y."""
    text = files["config.g"]
    skew = words(text, "M556")
    tangent = skew["X"] / skew["S"] if skew else 0.0
    return steps_moved(text, printer, bed, np.outer(tangent * bed[:, 1], [1, 0]))


def klipper(files: Files, printer: Printer, bed: np.ndarray) -> np.ndarray:
    """SET_SKEW's three lengths are AC, BD and AD of a printed parallelogram; x − tangent·y."""
    text, tangent = files["klipper.cfg"], 0.0
    if found := re.search(r"SET_SKEW XY=([\d.]+),([\d.]+),([\d.]+)", text):
        ac, bd, ad = map(float, found.groups())
        side = np.sqrt(2 * ac**2 + 2 * bd**2 - 4 * ad**2) / 2
        tangent = np.tan(np.pi / 2 - np.arccos((ac**2 - side**2 - ad**2) / (2 * side * ad)))
    motors = printer.to_motor(bed - np.outer(tangent * bed[:, 1], [1, 0]))
    said = [re.search(rf"\[stepper_{a}\]\nrotation_distance: ([\d.]+)", text) for a in "xy"]  # none where it is right
    turns = [axis.mm_per_turn for axis in printer.axes[:2]]
    return motors * [turn / float(line[1]) if line else 1.0 for turn, line in zip(turns, said, strict=True)]


def linuxcnc(files: Files, printer: Printer, bed: np.ndarray) -> np.ndarray:
    """A file of type 0: nominal − forward (or − reverse), interpolated at the joint's place, is added to it."""
    motors = printer.to_motor(bed)
    places = np.empty_like(motors)
    for i in range(2):
        section = files["joints.ini"].split(f"[JOINT_{i}]")[1]
        assert re.search(r"COMP_FILE_TYPE = (\d)", section)[1] == "0"
        rows = np.array([line.split() for line in files[f"joint{i}.comp"].splitlines()], float)
        assert len(rows) <= 256
        forward = np.diff(motors[:, i], prepend=motors[0, i]) > 0
        trims = [np.interp(motors[:, i], rows[:, 0], rows[:, 0] - rows[:, 1 + k]) for k in range(2)]
        places[:, i] = motors[:, i] + np.where(forward, *trims)
    return places


FIRMWARES: dict[str, Firmware] = {"marlin": marlin, "rrf": rrf, "klipper": klipper, "linuxcnc": linuxcnc}


def error_mm(mechanism: Mechanism, bed: np.ndarray, motors: np.ndarray) -> float:
    """Drive the printer to motor positions one after the other; the RMS error, the mean shift taken off."""
    belts = np.empty_like(motors)
    for i, transmission in enumerate(mechanism.transmissions):
        lower, upper = transmission.branches_mm(motors[:, i])
        belt = upper[0]  # homed against the lower end
        for n in range(len(motors)):
            belt = belts[n, i] = min(max(belt, lower[n]), upper[n])
    error = mechanism.frame.apply(mechanism.printer.from_motor(belts)) - bed
    return naive_mend.rms(np.linalg.norm(error - error.mean(axis=0), axis=1))


def walk(printer: Printer) -> np.ndarray:
    rng = np.random.default_rng(2)
    size = np.array([printer.x.length_mm, printer.y.length_mm])
    return np.array([printer.x.min_mm, printer.y.min_mm]) + size * rng.uniform(0.1, 0.9, (800, 2))


def judged(corruption: Corruption, printer: Printer, firmware: str) -> tuple[float, float, float]:
    """Return the error before, the error with what was exported, and what the export said it would be."""
    mechanism = corruption.lower(printer).homed()
    assert isinstance(mechanism, Mechanism)
    export, bed = EXPORTS[firmware](mechanism), walk(printer)
    motors = FIRMWARES[firmware](dict(export.files), printer, bed)
    return error_mm(mechanism, bed, printer.to_motor(bed)), error_mm(mechanism, bed, motors), export.after_mm


@pytest.mark.parametrize("printer", [ENDER3, COREXY], ids=lambda printer: printer.name)
@pytest.mark.parametrize("firmware", ["marlin", "rrf", "klipper"])
@pytest.mark.parametrize("fault", ["scale", "skew"])
def test_scale_and_skew_go(firmware: str, fault: str, printer: Printer) -> None:
    before, after, said = judged({"scale": SCALE, "skew": SKEW}[fault], printer, firmware)
    assert before > 0.3
    assert after < 0.003
    assert said == pytest.approx(after, abs=0.003)


@pytest.mark.parametrize("firmware", ["marlin", "klipper"])
def test_skew_learned_as_two_scales_and_a_turn_is_exported_as_skew(firmware: str) -> None:
    scales = Corruption(tuple(Drive(pulley=WrongRadius(share * COREXY.x.radius_mm)) for share in (1.004, 0.996)))
    turn = np.zeros((2, 10))
    turn[0, 2], turn[1, 1] = 0.4, -0.4  # mm in 100: what the learner leaves to the frame of a CoreXY
    mechanism = Mechanism(COREXY, scales.lower(COREXY).transmissions, Frame(turn)).homed()
    export, bed = EXPORTS[firmware](mechanism), walk(COREXY)
    assert error_mm(mechanism, bed, COREXY.to_motor(bed)) > 0.4
    assert error_mm(mechanism, bed, FIRMWARES[firmware](dict(export.files), COREXY, bed)) < 0.01


@pytest.mark.parametrize("firmware", ["marlin", "rrf", "linuxcnc"])
def test_play_goes(firmware: str) -> None:
    before, after, said = judged(PLAY, ENDER3, firmware)
    assert before > 0.3
    assert after < 0.002
    assert said == pytest.approx(after, abs=0.002)


def test_rrf_takes_the_play_of_a_corexys_motors() -> None:
    before, after, said = judged(PLAY, COREXY, "rrf")
    assert before > 0.25
    assert after < 0.002
    assert said == pytest.approx(after, abs=0.002)


@pytest.mark.parametrize(("firmware", "left_mm"), [("marlin", 0.003), ("rrf", 0.003), ("klipper", 0.41)])
def test_all_together(firmware: str, left_mm: float) -> None:
    before, after, said = judged(ALL, ENDER3, firmware)
    assert before > 0.8
    assert after < left_mm
    assert said == pytest.approx(after, rel=0.15, abs=0.003)


@pytest.mark.parametrize("printer", [ENDER3, COREXY], ids=lambda printer: printer.name)
def test_linuxcnc_takes_pulleys_too(printer: Printer) -> None:
    bent = Corruption(
        (Drive(pulley=EccentricBore(0.5, 1.0), belt=Play(0.4)), Drive(pulley=EccentricBore(0.3), belt=Play(0.6)))
    )
    before, after, said = judged(bent, printer, "linuxcnc")
    assert before > 0.3
    assert after < 0.005
    assert said == pytest.approx(after, abs=0.003)


@pytest.mark.parametrize("firmware", ["marlin", "rrf", "klipper"])
def test_a_stretched_frame_is_scale(firmware: str) -> None:
    """Calliper measurements give the axes' scales as a frame."""
    coefficients = np.zeros((2, 10))
    coefficients[0, 1], coefficients[1, 2] = 0.3, -0.2
    mechanism = Mechanism(ENDER3, PLAY.lower(ENDER3).transmissions, Frame(coefficients)).homed()
    export, bed = EXPORTS[firmware](mechanism), walk(ENDER3)
    motors = FIRMWARES[firmware](dict(export.files), ENDER3, bed)
    left = 0.41 if firmware == "klipper" else 0.003
    assert error_mm(mechanism, bed, motors) < left < error_mm(mechanism, bed, ENDER3.to_motor(bed))


@pytest.mark.parametrize("firmware", ["marlin", "rrf"])
def test_a_setting_that_stays_as_it_is_is_not_written(firmware: str) -> None:
    """The owner's own steps a millimetre and backlash are not the preset's: what is not changed has no word."""
    mechanism = Corruption((Drive(belt=Play(0.4)), Drive())).lower(ENDER3).homed()
    assert isinstance(mechanism, Mechanism)
    ((_, text),) = EXPORTS[firmware](mechanism).files
    assert "M92" not in text
    assert words(text, "M425") == {"X": 0.4} | ({"F": 1.0} if firmware == "marlin" else {"S": 1.0})
    half = Corruption((Drive(), Drive(pulley=WrongRadius(1.02 * RADIUS_MM)))).lower(ENDER3).homed()
    assert isinstance(half, Mechanism)
    ((_, text),) = EXPORTS[firmware](half).files
    assert list(words(text, "M92")) == ["Y"]
    assert "to undo now: M92 Y80.00000 (or" in text
    assert "M425" not in text


@pytest.mark.parametrize("printer", [ENDER3, COREXY], ids=lambda printer: printer.name)
@pytest.mark.parametrize("firmware", ["marlin", "rrf", "klipper"])
def test_scale_for_an_owner_whose_steps_are_not_the_presets(firmware: str, printer: Printer) -> None:
    """The factor in the comment times the owner's own value is what a printer with that value needs."""
    mechanism = SCALE.lower(printer).homed()
    assert isinstance(mechanism, Mechanism)
    ((_, text),) = EXPORTS[firmware](mechanism).files
    if firmware == "klipper":
        new = [float(each) for each in re.findall(r"^rotation_distance: ([\d.]+)", text, re.MULTILINE)]
        said = re.findall(r"^# assumes ([\d.]+) until now; .* multiply it by ([\d.]+)$", text, re.MULTILINE)
    else:
        new = list(words(text, "M92").values())
        line = re.search(
            r"^; assumes X([\d.]+) Y([\d.]+) until now; .*: X by ([\d.]+) and Y by ([\d.]+)$", text, re.MULTILINE
        )
        assert line is not None
        assert ("M503" in line[0]) == (firmware == "marlin")
        said = [(line[1], line[3]), (line[2], line[4])]
    assert [float(old) * float(share) for old, share in said] == pytest.approx(new, rel=1e-6)
    assert len(new) == 2
    assert text.count("assumes") == len(said) // (1 if firmware == "klipper" else 2)
