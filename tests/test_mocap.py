"""Motion capture as the authors published it, cut into traverses."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from printmend.errors import TraceError
from printmend_lab.bench.measured import read_pulleys
from printmend_lab.bench.traverse import cut, detrended, read_captures, read_runs

TURN_MM, SPEED_MM, LENGTH_MM = 40.0, 0.05, 180.0


def frames(rng: np.random.Generator, ways: tuple[int, ...] = (1, -1, 1, -1), *, size_mm: float = 0.4) -> np.ndarray:
    """The speed [mm a frame] of a carriage that goes over its bed and back, with a rapid way at the end."""
    count, parts = round(LENGTH_MM / SPEED_MM), [np.zeros(400)]
    for way in ways:
        place = np.linspace(0, LENGTH_MM, count + 1)
        if way < 0:
            place = place[::-1]
        parts += [np.diff(place + size_mm * np.sin(2 * np.pi * place / TURN_MM)), np.zeros(400)]
    parts += [np.full(800, -LENGTH_MM / 800), np.zeros(400)]
    speed = np.concatenate(parts) + rng.normal(0, 0.004, sum(map(len, parts)))
    speed[1000:1014] = np.nan  # the marker is lost
    return speed


def write_clone(folder: Path, rng: np.random.Generator) -> Path:
    place = folder / "20220902_Experiments_All" / "SmoothPlot_line_allspeeds"
    place.mkdir(parents=True)
    savemat(place / "dudt_square_40.mat", {"dudt_40": frames(rng)[:, None]})
    (folder / "dudw_comparable").mkdir()
    savemat(folder / "dudw_comparable" / "egg_0.mat", {"dudw": np.zeros((3, 1))})
    return folder


def test_traverses_are_what_the_pulley_does(rng: np.random.Generator) -> None:
    found = cut(frames(rng), "made", 40.0)
    assert [item.direction for item in found] == [1, -1, 1, -1]
    for item in found:
        assert item.length_mm == pytest.approx(LENGTH_MM - 20, abs=3)
        wave = np.stack([f(2 * np.pi * item.travel_mm / TURN_MM) for f in (np.sin, np.cos)], axis=1)
        columns = np.column_stack([detrended(item.travel_mm, one) for one in wave.T])
        size, *_ = np.linalg.lstsq(columns, item.error_mm, rcond=None)
        assert np.hypot(*size) == pytest.approx(0.4, abs=0.05)


def test_a_straight_pulley_leaves_the_noise(rng: np.random.Generator) -> None:
    for item in cut(frames(rng, size_mm=0.0), "made", 40.0):
        # a sum of 3200 frames of 0.004 mm wanders by 0.2 mm, less its line
        assert item.error_mm.std() < 0.2


def test_a_clone_is_a_set_of_runs(tmp_path: Path, rng: np.random.Generator) -> None:
    found = read_runs(write_clone(tmp_path / "clone", rng))
    assert {(item.shape, item.speed_mm_s) for item in found} == {("line", 40.0)}
    (only,) = read_pulleys(tmp_path / "clone")
    assert (only.name, len(only.learned), len(only.judged)) == ("line 40", 2, 2)


def test_what_is_no_capture_is_named(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match="clone RenzoCab"):
        read_captures(tmp_path)
    path = tmp_path / "SmoothPlot_line_allspeeds__dudt_square_40.mat"
    path.write_text("no")
    with pytest.raises(TraceError, match="MATLAB"):
        read_captures(tmp_path)
    savemat(path, {"a": np.zeros(900), "b": np.zeros(3)})
    with pytest.raises(TraceError, match="one signal"):
        read_captures(tmp_path)


def test_the_corpus_has_eighteen_whole_traverses_a_run(corpus: Path) -> None:
    found = read_captures(corpus / "measured" / "noncircular_pulleys_mocap")
    for shape in ("ideal", "line", "oval"):
        for speed in (40.0, 80.0, 120.0):
            mine = [item for item in found if (item.shape, item.speed_mm_s) == (shape, speed)]
            lengths = np.array([item.length_mm for item in mine])
            assert len(mine) == 18
            assert np.ptp(lengths) < 0.03 * lengths.mean()
