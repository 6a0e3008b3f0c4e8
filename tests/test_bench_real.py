"""Measured traverses: reading, alignment, and learning what a pulley repeats."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.errors import InputError, TraceError
from printmend_lab.bench.real import real_cases, real_table, scatter_mm2
from printmend_lab.bench.traverse import COLUMNS, Traverse, detrended, middles_mm, read_traverses

TURN_MM, LAG_MM, MIDDLE_MM = 42.3, 0.8, 85.0


def pulley_mm(angle: np.ndarray) -> np.ndarray:
    """A made-up position error over the pulley's angle, the latter as travel."""
    return 0.6 * np.cos(2 * np.pi * angle / TURN_MM) + 0.1 * np.sin(2 * np.pi * 3 * angle / TURN_MM + 1)


def traverse(
    rng: np.random.Generator, direction: int, *, start: float = 0.0, count: int = 341, walk: float = 0.0
) -> Traverse:
    travel = np.arange(count) * 0.5
    place = direction * (travel + start - MIDDLE_MM)
    error = direction * (pulley_mm(place + (LAG_MM if direction < 0 else 0.0)))
    drift = np.cumsum(rng.normal(0, walk * np.sqrt(0.005), count))
    noisy = error + drift + rng.normal(0, 0.03, count)
    return Traverse("made", 80.0, 0, direction, travel, detrended(travel, noisy))


def test_traverses_of_unequal_length_share_their_middle(rng: np.random.Generator) -> None:
    items = [traverse(rng, 1, count=count) for count in (349, 339, 240, 345)]
    np.testing.assert_allclose(middles_mm(items), [87.0, 84.5, 84.5, 86.0])
    broken_first = [items[2], items[0], items[1]]
    np.testing.assert_allclose(middles_mm(broken_first), [87.0, 87.0, 84.5])
    # broken off beside the other direction, though not beside its own
    both = [traverse(rng, 1, count=361), traverse(rng, -1, count=341), traverse(rng, -1, count=357)]
    np.testing.assert_allclose(middles_mm(both), [90.0, 89.0, 89.0])


def test_the_floor_is_the_noise(rng: np.random.Generator) -> None:
    starts = np.array((0.0, 2.0, 1.0) * 8)
    items = [traverse(rng, 1, start=start) for start in starts]
    aligned = scatter_mm2(items, MIDDLE_MM - starts)
    assert np.sqrt(aligned) == pytest.approx(0.03, rel=0.1)
    assert scatter_mm2(items, np.full(24, MIDDLE_MM)) > 2 * aligned


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
    from printmend_lab.cli.bench import command

    items = [traverse(rng, sign, walk=0.2) for sign in (1, -1, 1, -1, 1, -1, 1, 1, -1, 1, -1)]
    data = write_csv(tmp_path / "made.csv", items)
    done = CliRunner().invoke(command, ["real", str(data), "--out", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    (line,) = json.loads(done.stdout)["lines"]
    assert line["later"] == 9
    assert 0.8 * line["floor_mm"] < line["periodic_mm"] < line["plain_mm"] < line["raw_mm"]
    assert line["shipped_mm"] < 0.7 * line["raw_mm"]
    assert len((tmp_path / "out" / "real.jsonl").read_text().splitlines()) == 6
    few = write_csv(tmp_path / "few.csv", items[:4])
    done = CliRunner().invoke(command, ["real", str(few), "--out", str(tmp_path / "few")])
    assert "made 80 mm/s: expected three" in done.stderr
    assert isinstance(done.exception, InputError)


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


def test_real_pulleys(corpus: Path, tmp_path: Path) -> None:
    """A measured pulley's error falls by 4 and more, not below the floor."""
    path = corpus / "measured" / "noncircular_pulleys_mocap" / "position_error_by_travel.csv"
    items = read_traverses(path)
    assert len({(item.shape, item.speed_mm_s) for item in items}) == 9
    (line,), _ = real_table([case for case in real_cases(path, items) if case.body == "line 40"], tmp_path)
    assert line.floor_mm < line.periodic_mm < line.plain_mm < 0.25 * line.raw_mm
    assert line.shipped_mm < 0.25 * line.raw_mm
