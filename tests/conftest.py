"""Fixtures shared by all tests."""

import gc
import os
import pkgutil
from collections.abc import Iterator
from pathlib import Path

# One thread a worker: threads that share small matrices wait for each other on busy cores, four times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from printmend.infer.posterior import ROUNDS
from printmend.printer import Printer, read_printer
from tests.once import remembered

gc.disable()  # until all tests are collected: that makes no garbage, and looking for some took a third of its time

CORPUS = Path(__file__).resolve().parents[1].parent / "shared" / "corpus"


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def corpus() -> Path:
    """The folder of real STL, G-code and measured files; it lies beside the checkout, never in it."""
    if not CORPUS.is_dir():
        pytest.skip(f"the corpus of real files is not beside the checkout ({CORPUS})")
    return CORPUS


ONCE = {
    "learn.learned._learned": 16, "mend.update.measured_again": 16, "mend.verify.measured_again": 32,
    "mend.part.fit_walls": 64, "mend.fit.measure_part": 16,
}  # fmt: skip


@pytest.fixture(scope="module")
def once() -> Iterator[None]:
    """What a measurement says is worked out once in a file that asks for this, whether its tests or commands ask."""
    with pytest.MonkeyPatch.context() as patch:
        for name, most in ONCE.items():
            patch.setattr(f"printmend.{name}", remembered(pkgutil.resolve_name(f"printmend.{name}"), most))
        yield


@pytest.fixture(scope="session", autouse=True)
def one_round() -> Iterator[None]:
    """Each machine is drawn by one round of its chain, where a test does not ask for `all_rounds`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("printmend.infer.posterior.ROUNDS", 1)
        yield


@pytest.fixture
def all_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Machines are drawn as an owner's are, for tests of the draws and of printed figures."""
    monkeypatch.setattr("printmend.infer.posterior.ROUNDS", ROUNDS)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261121)


@pytest.fixture(params=["ender5", "ender3", "corexy"])
def printer(request: pytest.FixtureRequest) -> Printer:
    return read_printer(request.param)


@pytest.fixture
def ender5() -> Printer:
    return read_printer("ender5")
