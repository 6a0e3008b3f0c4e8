"""Outlines with few parameters: what they unwind, and what a part of a turn tells of the rest."""

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, FlatSpot, LooseBelt, PublishedHull
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.greybox import Greybox
from printmend_lab.greybox.pulley import ANY_PULLEY, OUTLINES, Outline
from printmend_lab.sampling import sample
from tests.naive_greybox import unwound

PRINTER = read_printer("ender5")


@pytest.mark.parametrize("outline", [*OUTLINES[:3], *OUTLINES[9:], ANY_PULLEY[0]], ids=lambda each: each.kind)
def test_unwinds_what_its_heights_say(outline: Outline, rng: np.random.Generator) -> None:
    angle = np.linspace(-4.0, 9.0, 25)
    centre = np.where(np.isnan(outline.centre), rng.uniform(0, 6), outline.centre)
    q = centre + 0.3 * np.where(np.isnan(outline.centre), 0.0, outline.spread) * rng.uniform(-1, 1, len(centre))
    value, slope = outline.unwound(q, angle)
    assert np.ptp(value - unwound(outline, q, angle)) < 1e-5
    for i, step in enumerate(1e-6 * np.eye(len(q))):
        difference = (outline.unwound(q + step, angle)[0] - outline.unwound(q - step, angle)[0]) / 2e-6
        assert np.ptp(difference - slope[:, i]) < 1e-6


def seen(corruption: Corruption, share: float, noise_mm: float = 0.0, seed: int = 0) -> tuple[Twin, Trace]:
    """Go to and fro over a share of a turn on the lattice, some rows stopping on the way."""
    twin = Twin.of(corruption, PRINTER)
    steps = round(200 * share)
    there = np.concatenate([np.arange(steps + 1), np.arange(steps)[::-1]])
    back = np.concatenate([there, there[1 : steps // 2], there[1 : steps // 2][::-1], there[1:]])
    way = 100.0 + 0.2 * np.stack([back, np.roll(back, 7)], axis=1)
    way[:, 1] = np.clip(way[:, 1], 100.0, 100.0 + 0.2 * steps)
    printed = twin.follow(way)
    return twin, Trace(way, printed + np.random.default_rng(seed).normal(0, noise_mm, printed.shape))


def errors_mm(twin: Twin, trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the branches of the first motor over one turn [2, N], the offset off, and their sds."""
    model = Greybox().fit(trace, PRINTER, rng=np.random.default_rng(0))
    at = trace.commanded_mm.mean(axis=0)[0] + np.linspace(-20.0, 20.0, 201)
    found = np.stack(model.mechanism.transmissions[0].branches_mm(at))
    true = np.stack(twin.mechanism.transmissions[0].branches_mm(at))  # type: ignore[union-attr]
    error = found - true
    return error - error[:, 100].mean(), np.stack(model.drives[0].sd_mm(at))


def broken(pulley, **parts) -> Corruption:
    return Corruption((Drive(pulley=pulley, **parts), Drive()))


def hull(seed: int = 4):
    return sample("fourier", np.random.default_rng(seed)).drives[0].pulley


@pytest.mark.parametrize(
    ("pulley", "share"),
    [
        (hull(), 0.6),
        (Ellipse(7.4, 5.2, 1.0), 0.2),
        (EccentricBore(0.9, 2.0), 0.3),
        (FlatSpot(1.2, 2.6), 0.5),
    ],
    ids=["fourier", "ellipse", "eccentric", "flat"],
)
def test_a_print_without_noise_tells_the_rest_of_the_turn(pulley, share: float) -> None:
    error, sd = errors_mm(*seen(broken(pulley), share))
    assert np.abs(error).max() < 3e-3
    # a round pulley may have a flat where nobody looked
    assert sd.max() < (0.3 if isinstance(pulley, EccentricBore) else 3e-3)


def test_a_flat_that_was_not_seen_is_not_ruled_out() -> None:
    error, sd = errors_mm(*seen(broken(FlatSpot(1.2, 0.0, 6.0)), 0.4))
    assert np.abs(error).max() > 0.2
    assert np.abs(error).max() < 7 * sd.max()


def test_play_hides_no_outline() -> None:
    """Play that differs over the turn, as a loose belt's does."""
    error, _ = errors_mm(*seen(broken(Ellipse(7.4, 5.2, 1.0), belt=LooseBelt(1.1, 0.9)), 0.4))
    assert np.abs(error).max() < 5e-3


@pytest.mark.parametrize(
    ("pulley", "limit_mm"), [(Ellipse(7.4, 5.2, 1.0), 0.05), (PublishedHull("triangle", 0.6), 0.15)]
)
def test_with_noise_only_what_is_surer_is_believed(pulley, limit_mm: float) -> None:
    """Half a rounded triangle looks like half of one with sharp corners: its symmetry is the better guess."""
    error, _ = errors_mm(*seen(broken(pulley), 0.55, 0.05, seed=3))
    assert np.sqrt((error**2).mean()) < limit_mm
