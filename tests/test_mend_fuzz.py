"""Damaged G-code ends in a result or in an error that says what was wrong; a result is never half of one."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from printmend.errors import PrintmendError
from printmend.mend import mend_gcode
from tests.mending import BENT, PLAY, SQUARE, START, exactly, judge, mended
from tests.programs import program
from tests.test_mend_motion import ARCS
from tests.test_mend_text import HEAD, TAIL

BASE = (
    HEAD
    + SQUARE
    + b"".join(ARCS.values())
    + b"G91\nG1 X1 Y1 E.1\nG90\nG92 X0 Y0\nG20\nG1 X1 E1\nG21\nM82\nG1 E5\n"
    + TAIL
)
SPLINTERS = [
    b"G1", b"G2 ", b"G28", b"G92 X", b"X1e9", b"Y-1e-9", b"E", b"F0", b"F-5", b"I0 J0", b"R1e-9", b"R1", b"nan", b"inf",
    b"\n", b"\r", b"\0", b"\xff", b"*", b"N-1", b";", b"(", b")", b"{", b"G91\n", b"G20\n", b"G18\n", b"M486 S0\n",
    b"PAUSE\n", b"X999999999999", b"P99999", b"G53 ", b"G10 L2 P1 X5\n", b"T1\n", b"-", b".", b"+", b"0" * 400,
    b"X.Y.Z.", b"G90.1\n", b"M221 S0\n", b"M200 D0\n",
]  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    text = bytearray(BASE)
    for _ in range(draw(st.integers(1, 8))):
        at = draw(st.integers(0, len(text)))
        match draw(st.integers(0, 3)):
            case 0:
                text[at:at] = draw(st.sampled_from(SPLINTERS))
            case 1:
                del text[at : at + draw(st.integers(1, 60))]
            case 2:
                text[at : at + 1] = draw(st.binary(min_size=1, max_size=3))
            case _:
                cut = draw(st.integers(0, len(text)))
                text[at:at] = text[cut : cut + 80]
    return bytes(text)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(damaged(), st.sampled_from([PLAY, BENT]))
def test_mutations(text: bytes, mechanism) -> None:
    written, prediction = mended(text, mechanism)
    comments = [line for line in text.splitlines() if line.startswith(b"; prusaslicer_config")]
    assert [line for line in written.splitlines() if line.startswith(b"; prusaslicer_config")] == comments
    for errors in (prediction.before, prediction.after):
        assert np.isfinite([errors.rms_mm, errors.p95_mm, errors.max_mm]).all()
    assert b"nan" not in written.replace(b"nan", b"", text.count(b"nan"))


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.one_of(damaged(), st.binary(max_size=200), st.just(b"GCDE").map(lambda head: head + BASE)))
@example(BASE.replace(b"M83\n", b"").replace(b"G1 X60 Y60 E1\n", b"\xffG1 X60 Y60 E1\n", 1))  # E is unknown by one rule
def test_files(content: bytes) -> None:
    model = exactly(BENT)
    with tempfile.TemporaryDirectory() as name:
        source, output = Path(name) / "part.gcode", Path(name) / "out.gcode"
        source.write_bytes(content)
        try:
            mend_gcode(source, model, output)
        except PrintmendError as error:
            said = str(error)
        else:
            said = ""
        assert output.exists() == (said == "")
        assert "\n" not in said
        if output.exists():
            assert b"; mended by printmend" in output.read_bytes()
        assert source.read_bytes() == content


def test_nothing_but_the_start() -> None:
    assert mended(START, BENT)[0].startswith(b"G21\n")
    assert mended(b"", BENT)[0] == b""


@pytest.mark.parametrize("seed", range(40))
def test_random_programs_land_where_they_should(seed: int) -> None:
    """Modes, units, zeros, saved states, homing, pauses and arcs in any order, executed on the naive machine."""
    text = program(seed)
    judged = judge(text, PLAY if seed % 2 else BENT)
    assert judged.prediction.unknown == 0
    assert judged.after.max(initial=0.0) <= 0.0125
    before, after = (sum(move.filament for move in moves) for moves in (judged.wanted, judged.given))
    assert after == pytest.approx(before, abs=1e-4)
