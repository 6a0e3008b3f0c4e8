"""Bodies that are made here: the same for ever, closed, and of every kind."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import trimesh

from printmend.errors import InputError
from printmend_lab.body.generated import KINDS, Dice, generated_name, generated_solid
from printmend_lab.body.solid import stl_bytes
from printmend_lab.dataset.bodies import body_files

# number → the first digits of the SHA-256 of its STL; a change here needs another GENERATOR
DIGESTS = {
    0: "9206566bd575",
    1: "0113aa10aba7",
    2: "3e8155d2f08b",
    5: "e0860c490cde",
    9: "9423da596c4d",
    25: "6f2c365ec7d9",
}


@pytest.mark.parametrize("number", DIGESTS)
def test_a_seed_gives_the_same_file_for_ever(number: int) -> None:
    assert hashlib.sha256(stl_bytes(generated_solid(0, number))).hexdigest()[:12] == DIGESTS[number]


def test_bodies_are_of_all_kinds_closed_and_of_a_size_to_print() -> None:
    seen = set()
    for number in range(14):
        solid = generated_solid(3, number)
        seen.add(solid.name.partition("-")[0])
        edges = np.sort(solid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        _, count = np.unique(edges, axis=0, return_counts=True)
        assert (count % 2 == 0).all()  # no loose end in any slice
        assert trimesh.Trimesh(solid.vertices_mm, solid.faces, process=False).volume > 100
        assert (solid.vertices_mm.min(axis=0) == 0).all()
        assert 2 < solid.size_mm.min() <= solid.size_mm.max() < 120
    assert seen == set(KINDS)


def test_dice_are_even_and_keep_to_their_bounds() -> None:
    dice = Dice("a")
    drawn = np.array([dice.uniform(2.0, 4.0) for _ in range(2000)])
    assert abs(drawn.mean() - 3.0) < 0.05
    assert 2.0 <= drawn.min() < 2.01
    assert 3.99 < drawn.max() < 4.0
    assert {dice.whole(1, 3) for _ in range(50)} == {1, 2, 3}


def test_generated_bodies_are_files_like_others(tmp_path: Path) -> None:
    files = body_files(["generated:3"], made=tmp_path, seed=3)
    assert [path.stem for path in files] == [generated_name(3, number) for number in range(3)]
    written = files[0].stat().st_mtime_ns
    assert body_files(["generated:2"], made=tmp_path, seed=3) == files[:2]
    assert files[0].stat().st_mtime_ns == written
    for wrong in ("generated:", "generated:0", "generated:many", "generated:-1"):
        with pytest.raises(InputError, match="expected generated:1"):
            body_files([wrong], made=tmp_path)
