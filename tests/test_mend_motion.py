"""Every kind of motion: arcs, helices, vase mode, z-hops, single axes, tiny segments."""

import math
import re

import numpy as np
import pytest

from tests import naive_mend
from tests.mending import BENT, COREXY, ENDER3, PLAY, START, Judged, judge, mended

MODELS = pytest.mark.parametrize("mechanism", [PLAY, BENT], ids=["play", "bent"])
ARCS = {
    "quarter": b"G3 X80 Y80 I0 J20 E2 F1800\n",
    "clockwise": b"G2 X80 Y60 I10 J0 E2 F1800\n",
    "most of a circle": b"G2 X60 Y80 I20 J10 E4 F1800\n",
    "full circle": b"G2 X60 Y60 I15 J5 E5 F1800\n",
    "full circle, axes not named": b"G3 I15 J5 E5 F1800\n",
    "radius": b"G2 X80 Y70 R15 E2 F1800\n",
    "long way by radius": b"G3 X80 Y70 R-15 E4 F1800\n",
    "small": b"G2 X61 Y60 I0.5 J0 E.1 F1800\n",
}


def right(judged: Judged, most_mm: float = 0.012) -> None:
    assert naive_mend.rms(judged.before) > 0.08
    assert judged.rms_mm <= 0.006
    assert judged.after.max() <= most_mm
    wanted = sum(move.filament for move in judged.wanted)
    assert sum(move.filament for move in judged.given) == pytest.approx(wanted, abs=1e-4)


@MODELS
@pytest.mark.parametrize("name", ARCS)
def test_arcs(mechanism, name: str) -> None:
    right(judge(START + ARCS[name] + b"G1 X62 Y50 E1\n", mechanism))


@pytest.mark.parametrize("name", ARCS)
def test_arcs_stay_arcs_where_only_play_is_wrong(name: str) -> None:
    text = mended(START + ARCS[name], PLAY)[0]
    drawn = [line for line in text.splitlines() if b"E" in line]
    assert all(line.startswith((b"G2 ", b"G3 ")) for line in drawn)
    assert len(drawn) <= 5  # one for each quadrant


def test_arcs_become_chords_otherwise() -> None:
    text = mended(START + ARCS["quarter"], BENT)[0]
    drawn = [line for line in text.splitlines() if b"E" in line]
    assert all(line.startswith(b"G1 ") for line in drawn)
    # a chord of 0.005 mm on a radius of 20 mm is 0.9 mm long; the quarter has 31 mm
    assert 31 / 0.9 * 0.8 < len(drawn) < 31 / 0.9 * 1.6


def test_relative_arcs_and_centres() -> None:
    right(judge(START + b"G91\nG2 X20 Y0 I10 J0 E2 F1800\nG3 X-10 Y5 I-5 J2 E2\nG90\nG1 X60 Y60 E1\n", PLAY))


@MODELS
def test_helix(mechanism) -> None:
    judged = judge(START + b"G2 X80 Y60 Z0.21 I10 J0 E2 F1800\n", mechanism)
    right(judged)
    heights = [move.end[2] for move in judged.given if move.draws]
    assert heights == sorted(heights)
    assert heights[-1] == pytest.approx(0.21)


def test_spiral_lift_draws_nothing() -> None:
    """Bambu's z-hop: a full circle that rises; it must still end where the next line begins."""
    text = (
        START + b"G1 X80 E1 F1800\nG1 E-.8 F1800\nG17\nG3 Z0.6 I1.2 J0.2 P1 F9000\n"
        b"G1 X60 Y65 F9000\nG1 Z.2\nG1 E.8 F1800\nG1 X80 E1\n"
    )
    right(judge(text, PLAY))
    right(judge(text, BENT))


def test_other_planes() -> None:
    text = START + b"G18\nG3 X70 Z0.2 I5 K0 E1 F1800\nG17\nG1 X80 Y70 E1\n"
    written, prediction = mended(text, BENT)
    assert prediction.after.rms_mm < 0.01
    tops = [float(z) for z in re.findall(rb"Z(-?[\d.]+)", written)]
    assert max(tops) == pytest.approx(5.2, abs=0.02)


def test_vase() -> None:
    t = np.linspace(0, 6 * np.pi, 240)
    rows = [
        f"G1 X{70 + 10 * math.cos(a):.3f} Y{70 + 10 * math.sin(a):.3f} Z{0.2 + 0.2 * a / 6.2832:.4f} E0.03" for a in t
    ]
    text = START + b"G0 X80 Y70\nG1 F1500\n" + "\n".join(rows).encode() + b"\n"
    for mechanism in (PLAY, BENT):
        judged = judge(text, mechanism)
        assert judged.rms_mm <= 0.006
        heights = [move.end[2] for move in judged.given if move.draws]
        assert heights == sorted(heights)


@MODELS
def test_z_hop_and_travels(mechanism) -> None:
    hop = b"G1 E-1 F2400\nG1 Z.6 F600\nG0 X%d Y%d F7200\nG1 Z.2 F600\nG1 E1 F2400\nG1 X%d Y%d E1 F1800\n"
    text = START + b"".join(hop % row for row in ((70, 60, 60, 64), (65, 80, 75, 70), (80, 62, 70, 62)))
    right(judge(text, mechanism))


@MODELS
def test_single_axes(mechanism) -> None:
    right(judge(START + b"G1 X80 E1 F1800\nG1 Y80 E1\nG0 X70 F6000\nG0 Y62\nG1 X60 E1 F1800\nG1 Y80 E1\n", mechanism))


@MODELS
def test_tiny_segments(mechanism) -> None:
    t = np.linspace(0, 4 * np.pi, 300)
    rows = [f"G1 X{60 + 4 * a:.3f} Y{60 + 3 * math.sin(a):.3f} E0.002" for a in t]
    judged = judge(START + b"G1 F1800\n" + "\n".join(rows).encode() + b"\n", mechanism)
    right(judged)
    assert judged.prediction.takeups == 4
    assert judged.prediction.commands < 1.02 * judged.prediction.moves + 6


@pytest.mark.parametrize("name", ["full circle", "quarter", "most of a circle"])
def test_arcs_on_a_corexy(name: str) -> None:
    from printmend.corruption import Corruption, Drive
    from printmend.corruption.belt import Play

    play = Corruption((Drive(belt=Play(0.5)), Drive(belt=Play(0.3)))).lower(COREXY).homed()
    right(judge(START + ARCS[name] + b"G1 X62 Y50 E1\n", play))


def test_wipes_are_travels() -> None:
    text = START + b"G1 X80 E1 F1800\nG1 X75 E-.5 F6000\nG1 X70 E-.5\nG0 X60 Y70\nG1 E1\nG1 X80 E1 F1800\n"
    right(judge(text, BENT))


def test_moves_outside_the_bed_stay_where_they_were() -> None:
    """A purge line at X −2 is the owner's; nothing goes further out because of us."""
    text = START + b"G0 X-2 Y20 F6000\nG1 Y150 E10 F1500\nG1 X1 F3000\nG1 X30 E2\n"
    judged = judge(text, PLAY)
    assert min(move.end[0] for move in judged.given) == pytest.approx(-2.0)
    assert ENDER3.x.min_mm == 0
