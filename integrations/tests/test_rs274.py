"""LinuxCNC's interpreter as the second reader of arcs, planes, offsets and units."""

from pathlib import Path

import numpy as np
import pytest

from bench_rs274 import RefusedByInterpreter, difference_mm, interpreted, ours, plain

LETTERS, CENTRES = "XYZ", "IJK"
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}


def program(rng: np.random.Generator, lines: int) -> str:
    """Write moves and arcs in every plane, unit and mode, with offsets: what the two readers must agree on."""
    text, at, zero = ["G21 G90 G17", "G0 X50 Y50 Z50"], np.full(3, 50.0), np.zeros(3)
    unit, relative, plane = 1.0, False, 17

    def words(to: np.ndarray) -> str:
        away = (to - at if relative else to - zero) / unit
        return " ".join(f"{letter}{value:.7f}" for letter, value in zip(LETTERS, away, strict=True))

    for _ in range(lines):
        what = rng.choice(["line", "arc", "radius", "state"], p=[0.3, 0.35, 0.15, 0.2])
        first, second, along = PLANES[plane]
        if what == "state":
            chosen = rng.integers(5)
            if chosen == 0:
                plane = int(rng.choice([17, 18, 19]))
                text.append(f"G{plane}")
            elif chosen == 1:
                unit = 25.4 if unit == 1.0 else 1.0
                text.append("G20" if unit != 1.0 else "G21")
            elif chosen == 2:
                relative = not relative
                text.append("G91" if relative else "G90")
            elif chosen == 3:
                axis = int(rng.integers(3))
                now = np.round(rng.uniform(-2, 2) / unit, 3)
                zero[axis] = at[axis] - now * unit
                text.append(f"G92 {LETTERS[axis]}{now:.3f}")
            continue
        to = at.copy()
        if what == "line":
            to += rng.uniform(-9, 9, 3)
            text.append(f"G{rng.integers(2)} {words(to)}")
        else:
            radius, begin, sweep = rng.uniform(2, 20), rng.uniform(0, 6.28), rng.uniform(0.2, 6.0)
            clockwise = bool(rng.integers(2))
            centre = at[[first, second]] - radius * np.array([np.cos(begin), np.sin(begin)])
            angle = begin - sweep if clockwise else begin + sweep
            to[[first, second]] = centre + radius * np.array([np.cos(angle), np.sin(angle)])
            to[along] += rng.uniform(-1, 1)
            code = "G2" if clockwise else "G3"
            if what == "arc":
                i, j = (centre - at[[first, second]]) / unit
                text.append(f"{code} {words(to)} {CENTRES[first]}{i:.7f} {CENTRES[second]}{j:.7f}")
            else:
                text.append(f"{code} {words(to)} R{(radius if sweep < np.pi else -radius) / unit:.7f}")
        at = to
    return "\n".join(text) + "\n"


@pytest.mark.parametrize("seed", range(4))
def test_both_readers_go_the_same_way(seed: int, tmp_path: Path) -> None:
    text = program(np.random.default_rng(seed), 400)
    off, motions, arcs = difference_mm(ours(text), interpreted("F600\n" + text, tmp_path))
    assert motions > 250
    assert arcs > 120
    assert off < 0.005  # rs274 prints four decimals, of an inch at times, and the ends of an arc compound


def test_a_difference_would_be_seen(tmp_path: Path) -> None:
    text = plain("G0 X10 Y10\nG2 X20 Y10 I5 J0 E1 ; half a ring\nM104 S200\nG1 X1 Y1 E2\nG92 E0\n")
    assert "E" not in text
    read = interpreted(text, tmp_path)
    assert difference_mm(ours(text), read)[0] < 1e-4
    assert difference_mm(ours(text.replace("G2", "G3")), read)[0] == float("inf")
    assert difference_mm(ours(text.replace("X20", "X20.01")), read)[0] == pytest.approx(0.01, abs=1e-3)
    with pytest.raises(RefusedByInterpreter):
        interpreted("G21\nF600\nG2 X10 Y0 I1 J7\n", tmp_path)


def test_files_of_the_corpus_read_alike(tmp_path: Path) -> None:
    corpus = Path(__file__).resolve().parents[3] / "shared/corpus/gcode"
    if not corpus.is_dir():
        pytest.skip("the corpus of real files is not beside the checkout")
    for name in ("winder__Universal-G-Code-Sender/electric_turtle.nc", "Klipper3d__klipper/plane_b_0005.gcode",
                 "kageurufu__preprocess_cancellation/superslicer.gcode"):  # fmt: skip
        text = plain((corpus / name).read_text("latin-1"))
        off, motions, arcs = difference_mm(ours(text), interpreted(text, tmp_path))
        assert arcs > 200, name
        assert motions > 500, name
        assert off < 0.001, name
