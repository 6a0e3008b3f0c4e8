"""Measured traverses: reading, alignment, and learning what a pulley repeats."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.bench.periodic import fit
from printmend.bench.real import PROTOCOLS, plain_fit, real_lines, scatter_mm2
from printmend.bench.traverse import COLUMNS, Traverse, detrended, read_traverses, starts_mm
from printmend.errors import TraceError

TURN_MM, RETURN_MM = 42.3, 17.0


def pulley_mm(angle: np.ndarray) -> np.ndarray:
    """A made-up position error over the pulley's angle, the latter as travel."""
    return 0.6 * np.cos(2 * np.pi * angle / TURN_MM) + 0.1 * np.sin(2 * np.pi * 3 * angle / TURN_MM + 1)


def traverse(
    rng: np.random.Generator, direction: int, *, start: float = 0.0, count: int = 340, walk: float = 0.0
) -> Traverse:
    travel = np.arange(count) * 0.5
    angle = travel + start if direction > 0 else RETURN_MM - travel - start
    drift = np.cumsum(rng.normal(0, walk * np.sqrt(0.005), count))
    error = direction * pulley_mm(angle) + drift + rng.normal(0, 0.03, count)
    return Traverse("made", 80.0, 0, direction, 0, travel, detrended(travel, error))


def test_what_repeats_is_found_under_drift(rng: np.random.Generator) -> None:
    forth, back = traverse(rng, 1, walk=0.3), traverse(rng, -1, walk=0.3)
    model = fit(forth.travel_mm, forth.error_mm, back.travel_mm, back.error_mm)
    assert model.turn_mm == pytest.approx(TURN_MM, abs=0.3)
    assert (model.return_mm - RETURN_MM + TURN_MM / 2) % TURN_MM - TURN_MM / 2 == pytest.approx(0, abs=1.5)
    assert model.shared > 0.9
    later = traverse(rng, 1)
    predicted = detrended(later.travel_mm, model.error_mm(1, later.travel_mm))
    plain = detrended(later.travel_mm, plain_fit(forth)(later.travel_mm))
    residual, plain_residual = ((later.error_mm - p).std() for p in (predicted, plain))
    assert residual < 0.09  # 0.03 of it is white noise
    assert residual < 0.95 * plain_residual


def test_the_drift_is_not_learned(rng: np.random.Generator) -> None:
    """Without a pulley's error nothing repeats: the prediction is far smaller than the drift."""
    travel = np.arange(340) * 0.5
    drifts = [detrended(travel, np.cumsum(rng.normal(0, 0.03, 340))) for _ in range(2)]
    model = fit(travel, drifts[0], travel, drifts[1])
    assert model.error_mm(1, travel).std() < 0.4 * drifts[0].std()


def test_traverses_of_unequal_length_share_their_middle(rng: np.random.Generator) -> None:
    items = [traverse(rng, 1, count=count) for count in (349, 339, 240, 345)]
    np.testing.assert_allclose(starts_mm(items), [0.0, 2.5, 2.5, 1.0])
    broken_first = [items[2], items[0], items[1]]
    np.testing.assert_allclose(starts_mm(broken_first), [0.0, 0.0, 2.5])


def test_the_floor_is_the_noise(rng: np.random.Generator) -> None:
    items = [traverse(rng, 1, start=start) for start in (0.0, 2.0, 1.0) * 8]
    aligned = scatter_mm2(items, np.array((0.0, 2.0, 1.0) * 8))
    assert np.sqrt(aligned) == pytest.approx(0.03, rel=0.1)
    assert scatter_mm2(items, np.zeros(24)) > 2 * aligned


def write_csv(path: Path, items: list[Traverse]) -> Path:
    rows = [",".join(COLUMNS)]
    for segment, item in enumerate(items):
        sign = "+" if item.direction > 0 else "-"
        rows += [
            f"made,80,{segment},{sign},{travel},{error:.4f}"
            for travel, error in zip(item.travel_mm, item.error_mm, strict=True)
        ]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_command_prints_and_saves(tmp_path: Path, rng: np.random.Generator) -> None:
    from printmend.cli.bench import command

    items = [traverse(rng, sign, walk=0.2) for sign in (1, -1, 1, -1, 1, -1, 1, 1, -1, 1, -1)]
    data = write_csv(tmp_path / "made.csv", items)
    done = CliRunner().invoke(command, ["real", str(data), "--out", str(tmp_path / "out.json"), "--json"])
    assert done.exit_code == 0, done.output
    saved = json.loads((tmp_path / "out.json").read_text())
    (line,) = saved["lines"]
    assert line["later"] == 9
    assert line["floor_aligned_mm"] < line["aligned_mm"] < line["raw_mm"]
    assert line["plain_aligned_mm"] < line["raw_mm"]
    recordings = [item.recording for item in read_traverses(data)]
    assert recordings == [0] * 7 + [1] * 4
    assert PROTOCOLS == ("first", "recording")
    with pytest.raises(TraceError, match="made 80 mm/s: wanted three"):
        real_lines(read_traverses(data), "recording")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("a,b\n1,2\n", "pulley_shape"),
        (",".join(COLUMNS) + "\n", "no rows"),
        (",".join(COLUMNS) + "\nx,80,0,*,0,0\n", "line 2"),
        (",".join(COLUMNS) + "\nx,80,0,+,0,much\n", "line 2"),
        (",".join(COLUMNS) + "\n" + "x,80,0,+,0,0\n" * 9, "segment 0"),
    ],
)
def test_wrong_files_are_named(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(TraceError, match=named):
        read_traverses(path)


def test_real_pulleys(corpus: Path) -> None:
    """A measured pulley's error falls by 4 and more, not below the floor."""
    path = corpus / "measured" / "noncircular_pulleys_mocap" / "position_error_by_travel.csv"
    items = read_traverses(path)
    assert len({(item.shape, item.speed_mm_s) for item in items}) == 9
    (line,) = real_lines([t for t in items if (t.shape, t.speed_mm_s) == ("line", 40.0)], "first")
    assert line.floor_aligned_mm < line.aligned_mm < 0.25 * line.raw_mm
    assert line.turn_mm == pytest.approx(42, abs=0.5)  # 21 teeth


def test_slips_of_every_turn_are_half_expected_and_accidents_not(rng: np.random.Generator) -> None:
    """Four slips of 0.8 mm, one a turn, and one of 2 mm: only the former are predicted, at even odds."""
    forth, back = traverse(rng, 1), traverse(rng, -1)
    slips = sum(0.8 * (forth.travel_mm >= place) for place in (20.0, 63.0, 104.5, 147.0))
    model = fit(forth.travel_mm, detrended(forth.travel_mm, forth.error_mm + slips), back.travel_mm,
                detrended(back.travel_mm, back.error_mm + 2.0 * (back.travel_mm >= 90.0)))  # fmt: skip
    assert model.turn_mm == pytest.approx(TURN_MM, abs=0.4)
    np.testing.assert_allclose([place for place, _ in model.steps[0]], [20.0, 63.0, 104.5, 147.0], atol=0.6)
    np.testing.assert_allclose([height for _, height in model.steps[0]], 0.4, atol=0.08)
    assert model.steps[1] == ()
