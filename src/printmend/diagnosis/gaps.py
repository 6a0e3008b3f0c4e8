"""The gaps of a trace: what it did not show of a motor, and the print that would."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printmend.diagnosis.screw import HEALTHY_SD_MM, too_low
from printmend.effects.wobble import LEAST_TURNS, turns_of
from printmend.infer.fit import Fit
from printmend.messages import say

SECTORS_PER_TURN = 40  # sectors of 9° in which contacts are counted
ALL_SEEN = 0.95  # a larger share of the turn counts as all of it
LEAST_EITHER_WAY = 5  # marks that a motor must have gone either way, or its play cannot show
LEAST_CROSSING_MM = 3.0  # how far the other axis must move by itself, root mean square, for a crooked frame to show


@dataclass(frozen=True)
class Sight:
    """What the marks could see of one motor: the span of its contacts in ``turns``, the share of one turn that any of
    them met and that those ``forward`` and ``backward`` met, and how many of these there are."""

    turns: float
    angles: float
    forward_angles: float
    backward_angles: float
    forward: int
    backward: int


def gaps_of(fit: Fit, *, heights: bool = False) -> tuple[str, ...]:
    """Return the gaps of a trace, motor by motor, a sentence each; with ``heights`` those of Z, too."""
    printer, places = fit.scene.printer, fit.places.at(np.unique(fit.rows.mark))
    plays = {block.where for block in fit.blocks if block.effect in ("play", "breathing", "friction")}
    gaps = []
    for motor, (name, turn_mm) in enumerate(zip(printer.motors, fit.scene.turns_mm, strict=True)):
        seen = sight(places.motor_mm[:, motor], places.side[:, motor], turn_mm)
        gaps += motor_gaps(name.upper(), seen, turn_mm, plays=motor in plays)
    one, two = printer.to_motor(places.bed_mm).T if len(places) else np.zeros((2, 1))
    if not _crosses(one, two) and not _crosses(two, one):
        first, second = (name.upper() for name in printer.motors)
        gaps.append(say("moved-together-only-so-crooked-frame", first, second))
    return (*gaps, *_wobble_gap(fit)) if heights and fit.scene.layers else tuple(gaps)


def _wobble_gap(fit: Fit) -> Iterator[str]:
    """Say how exactly the layers tell a push of Z once a turn, found or not, where that is not enough."""
    if (turns := turns_of(fit.scene)) < LEAST_TURNS:
        lead_mm = fit.scene.printer.z.mm_per_turn
        yield too_low("wobble", turns * lead_mm, lead_mm)
        return
    blocks, state = fit.dictionary.blocks, fit.state
    if not any(block.effect == "wobble" for block in fit.blocks):
        tried = next(b for b, block in enumerate(blocks) if block.effect == "wobble")
        state = fit.search.posterior((*state.members, (tried, 0)), state.sigma_mm, rounds=0)
    sds_mm = np.sqrt(np.diag(state.covariance))
    own = [sds_mm[at][::2] for (b, _), at in zip(state.members, fit.dictionary.own(state.members), strict=True)
           if blocks[b].effect == "wobble"]  # fmt: skip
    if (sd_mm := float(np.sqrt(np.mean(np.square(own))))) > HEALTHY_SD_MM:
        yield say("z-told-mm-only-measure-more", say("z-wobble"), f"{sd_mm:.2f}")


def sight(motor_mm: np.ndarray, side: np.ndarray, turn_mm: float) -> Sight:
    """Return what marks [N] in contact at these positions of a motor, on these sides of its play, could see."""
    angles, counts = [], []
    seen = np.zeros(SECTORS_PER_TURN, bool)
    for way in (-1, 1):
        used = motor_mm[side == way]
        sector = (np.mod(used / turn_mm, 1.0) * SECTORS_PER_TURN).astype(np.int64) % SECTORS_PER_TURN
        hit = np.bincount(sector, minlength=SECTORS_PER_TURN) > 0
        # The neighbours of a hit count as seen, so that few marks are judged by their gaps and not by their count.
        hit |= np.roll(hit, 1) | np.roll(hit, -1)
        seen |= hit
        angles.append(float(hit.mean()))
        counts.append(len(used))
    # Whatever its neighbours, a span shorter than a turn leaves the rest of the turn unseen.
    turns = float(np.ptp(motor_mm[side != 0])) / turn_mm if (side != 0).any() else 0.0
    return Sight(turns, min(float(seen.mean()), turns), angles[0], angles[1], counts[0], counts[1])


def motor_gaps(name: str, seen: Sight, turn_mm: float, *, plays: bool) -> list[str]:
    """Return the gaps of one motor, and the prints that would close them."""
    gaps: list[str] = []
    if seen.angles < ALL_SEEN:
        longer = say("print-least-mm-along-better-two", f"{turn_mm:.0f}", name, f"{2 * turn_mm:.0f}")
        spread = say("points-lie-same-few-angles-each", f"{turn_mm:.0f}")
        gaps.append(
            say("seen-over-part-of-turn", name, f"{100 * seen.angles:.0f}", longer if seen.turns < 1 else spread)
        )
    if min(seen.forward, seen.backward) < LEAST_EITHER_WAY:
        way = say("forwards" if seen.forward > seen.backward else "backwards")
        gaps.append(say("measured-moving-only-so-play-unknown", name, way))
    elif plays and min(seen.forward_angles, seen.backward_angles) < ALL_SEEN <= seen.angles:
        less = say("forwards" if seen.forward_angles < seen.backward_angles else "backwards")
        share = 100 * min(seen.forward_angles, seen.backward_angles)
        gaps.append(say("moved-over-pulley-s-turn-only", name, less, f"{share:.0f}", f"{turn_mm:.0f}"))
    return gaps


def _crosses(own_mm: np.ndarray, other_mm: np.ndarray) -> bool:
    """Tell whether the other motor moved by itself, not only along with this one."""
    own, other = own_mm - own_mm.mean(), other_mm - other_mm.mean()
    together = float(own @ other) / max(float(own @ own), 1e-300)
    return float(np.std(other - together * own)) > LEAST_CROSSING_MM
