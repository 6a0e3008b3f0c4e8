"""What a misfit may do to a new print: its law is evaluated at the new print's places, with a random size.

A gantry that racks does not move a part in the middle of the bed, but moves one at the bed's end by much. A printer
that warms up is cold again when the next print begins. So a promise holds a misfit's law, not its size on the measured
print.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.promise.laws import LAWS, LONG_MM, TWO_MOTORS, LawRows, warmed
from printmend.saved.values import number, numbers, refuse, section_of

STAYS, SPEED, ENDED, BEGUN, VARIES, EARLY = "stays", "speed", "ended", "begun", "varies", "early"
LEARNED, CARRIED = "learned", "carried"
# Mean and standard deviation of the share of a law's measured size that a new print has, by what becomes of the misfit:
# it stays; it depends on speed; the model was learned as of the end of the measured print, so that only its further
# growth is left (ended); the model took it in as a part of another kind (learned), or of its own (carried).
SHARES = {STAYS: (1.0, 0.25), SPEED: (0.5, 0.3), ENDED: (0.0, 0.1), LEARNED: (0.0, 0.12), CARRIED: (0.0, 0.05)}
GOES_ON = 0.7  # standard deviation of the logarithm of a factor on the share of ENDED: some go on for much longer
# What grew evenly until the measured print ended stops with this probability; else it goes on in a new print as fast,
# to a factor whose logarithm has this standard deviation, for as long as the measured print was at most.
STOPS, SPEED_LOG_SD = 0.5, 0.4
# What shifted places while the measured print was made is gone with the next homing, and comes again if it does, where
# a motor slipped, a screw gave way or the machine warmed up; it stays where the end stop moved. Nothing tells these
# apart, so the model is of an early time (`BEGUN`), which makes no print much worse; a shift stays with this chance.
SHIFTS, SHIFT_STAYS = ("linear", "step", "creep"), 0.4
STAYED_LOG = (0.1, 0.3)  # mean and deviation of the logarithm of a factor on one that stays: some go on for longer
# Some misfits begin anew with every print, as warming does. The time at which a new part is printed is drawn evenly
# between these shares of the measured print's length.
VARIES_FROM, VARIES_TO = 0.1, 1.0
# Share of the measured print's length at which a model of state EARLY or BEGUN describes the printer: most parts are
# smaller than the measured print.
EARLY_DONE = 0.108
# How many times as fast as the measured print another one warms up, and the probability of each; the last stands for a
# printer that is still warm from the print before.
WARMING_SPEEDS = (0.6, 1.0, 1.4, 1.9, 2.6, 4.0, 1e6)
WARMING_CHANCES = (0.14, 0.25, 0.22, 0.17, 0.13, 0.06, 0.03)
LONGEST_MM = 1e9  # a model file may name no longer way of the measured print
_MOST_WEIGHTS = 2 * len(TWO_MOTORS)  # a model file may name no more weights of an effect


@dataclass(frozen=True, eq=False)
class DrawnCause:
    """Errors of one cause at N places of a print, for D drawn machines: ``columns`` [N, K] @ ``drawn`` [K, D]."""

    columns: np.ndarray
    drawn: np.ndarray

    def beside(self, other: "DrawnCause") -> "DrawnCause":
        """Return the sum of both."""
        return DrawnCause(np.hstack([self.columns, other.columns]), np.vstack([self.drawn, other.drawn]))


@dataclass(frozen=True, eq=False)
class Effect:
    """A misfit of one ``motor``: its size is the law of its ``kind`` times ``weights`` [Q] mm.

    ``state`` says what becomes of it in the next print (`SHARES`, `BEGUN`, `VARIES`, `EARLY`); ``detail`` and ``place``
    are the law's parameters.

    ``absorbed`` [3] mm is how much of it the model has taken in: as an offset, as play, as a scale. ``spans_mm``
    [4, 2] are the ends, in the measured print, of the motor's and the other motor's way and of the bed's axes;
    ``way_mm`` is how far that print went, 0 where this is not known.
    """

    kind: str
    motor: int
    weights: np.ndarray
    detail: float
    place: float
    state: str
    absorbed: np.ndarray
    spans_mm: np.ndarray
    period_mm: float
    way_mm: float = 0.0

    def law(self, one: LawRows) -> np.ndarray:
        """Return the misfit at rows [N] mm, what the model took in included."""
        return np.asarray(LAWS[self.kind](one, self.detail, self.place)[:, : len(self.weights)] @ self.weights)

    def drawn(self, places: "PrintPlaces", begun: np.ndarray, rng: np.random.Generator) -> "DrawnCause":
        """Return by how much the belt may be off at places of a new print [N, D].

        ``begun`` [D], from 0 to 1, draws how far a misfit that begins anew with each print has come; all effects of a
        drawn machine share it.
        """
        one = places.seen_by(self)
        columns = np.stack([self.law(one), absorbing(one) @ self.absorbed], axis=1)
        now = VARIES_FROM + (VARIES_TO - VARIES_FROM) * begun
        if self.state == VARIES:
            return DrawnCause(columns, np.stack([now, np.full_like(now, -1.0)]))
        if self.state == EARLY:
            return self._warming(places, columns[:, :1], now, rng)
        if self.state == BEGUN:
            return self._shifting(places, columns[:, :1], self.law(one.all_at(EARLY_DONE))[:, None], rng, len(begun))
        share = rng.normal(*SHARES[self.state], len(begun))
        if self.state == ENDED:
            share *= np.exp(rng.normal(0.0, GOES_ON, len(begun)))
        if self.state == ENDED and self.way_mm:
            more = columns[:, :1] * self._gone(places)[:, None]
            goes_on = (rng.random(len(begun)) > STOPS) * np.exp(rng.normal(0.0, SPEED_LOG_SD, len(begun)))
            return DrawnCause(np.hstack([columns[:, :1], more]), np.stack([share, goes_on]))
        if self.state in (STAYS, SPEED):
            return DrawnCause(columns, np.stack([share, -share]))
        return DrawnCause(columns[:, :1], share[None])

    def _gone(self, places: "PrintPlaces") -> np.ndarray:
        """Return how much of the measured print's length a new one has gone at its places [N], at most all of it."""
        return np.minimum(places.gone_mm / self.way_mm, 1.0) if self.way_mm else np.ones(len(places.gone_mm))

    def _shifting(
        self, places: "PrintPlaces", law: np.ndarray, early: np.ndarray, rng: np.random.Generator, draws: int
    ) -> "DrawnCause":
        """Return the error that a shift leaves in a print that was mended for the state at `EARLY_DONE`: all else of it
        where it stayed, and where it begins anew as much as by then."""
        again = {
            "linear": lambda: self._gone(places),
            "creep": lambda: warmed(self._gone(places), self.detail) / warmed(np.ones(1), self.detail),
            "step": lambda: np.zeros(len(law)),  # an accident
        }[self.kind]()
        stays = rng.random(draws) < SHIFT_STAYS
        goes_on = stays & (self.kind == "linear") & (rng.random(draws) > STOPS)
        anew = (goes_on | ~stays) * np.exp(rng.normal(0.0, SPEED_LOG_SD, draws))
        stayed = stays * np.exp(rng.normal(*STAYED_LOG, draws))
        return DrawnCause(np.hstack([law, law * again[:, None], early]), np.stack([stayed, anew, np.full(draws, -1.0)]))

    def _warming(
        self, places: "PrintPlaces", law: np.ndarray, now: np.ndarray, rng: np.random.Generator
    ) -> "DrawnCause":
        """Return the error that warming leaves in a print that was mended for the state at `EARLY_DONE`.

        The printer warms up as the print goes on, faster or slower than in the measured print (`WARMING_SPEEDS`).
        """
        share = self.detail
        early = warmed(np.array([EARLY_DONE]), share)
        if not self.way_mm:
            return DrawnCause(law, now[None] - early)
        grown = np.stack([warmed(places.gone_mm * speed / self.way_mm, share) for speed in WARMING_SPEEDS], axis=1)
        which = rng.choice(len(WARMING_SPEEDS), len(now), p=WARMING_CHANCES)
        return DrawnCause(law / warmed(np.ones(1), share) * (grown - early), np.eye(len(WARMING_SPEEDS))[:, which])

    def json(self) -> dict[str, Any]:
        """Return plain values."""
        plain = {key: value for key, value in vars(self).items() if not isinstance(value, np.ndarray)}
        arrays = {key: np.round(getattr(self, key), 6).tolist() for key in ("weights", "absorbed", "spans_mm")}
        return {**plain, "detail": float(self.detail), **arrays}


@dataclass(frozen=True, eq=False)
class PrintPlaces:
    """N places of a new print, as the laws need them.

    ``motor_mm`` [N, 2] are the motors' positions, ``bed_mm`` [N, 2] the places on the bed, ``side`` [N, 2] the side of
    its belt that each motor pushes, ``ways`` [N, 2] the directions of a CoreXY's axes (0 where not known), ``gone_mm``
    [N] the length of the print up to there.
    """

    motor_mm: np.ndarray
    bed_mm: np.ndarray
    side: np.ndarray
    ways: np.ndarray
    gone_mm: np.ndarray

    def seen_by(self, effect: Effect) -> LawRows:
        """Return the places as rows for the laws, in coordinates of the measured print, its time at the end."""
        own, other = self.motor_mm[:, effect.motor], self.motor_mm[:, 1 - effect.motor]
        spans = effect.spans_mm
        return LawRows(
            motor_mm=own,
            period_mm=effect.period_mm,
            done=np.ones(len(own)),
            side=-self.side[:, effect.motor].astype(float),  # a test counts the upper branch as +1
            own=_between(own, spans[0]),
            other=_between(other, spans[1]),
            beds=np.stack([_between(self.bed_mm[:, axis], spans[2 + axis]) for axis in range(2)], axis=1),
            across=self.side[:, 1 - effect.motor].astype(float),
            move_mm=np.full(len(own), LONG_MM),
            ways=self.ways,
            bed_mm=self.bed_mm,
        )


def absorbing(one: LawRows) -> np.ndarray:
    """Return the columns [N, 3] of an offset, play and a scale, by which most models take a misfit in."""
    return np.stack([np.ones(len(one.side)), one.side, one.own], axis=1)


def parse_effects(document: Mapping[str, Any]) -> tuple[Effect, ...]:
    """Return the effects that a model's document holds. Raise `ModelError` for a section that is none of ours."""
    misfit = document.get("misfit")
    if not isinstance(misfit, dict) or "effects" not in misfit:
        return ()
    subject = "the model [misfit]"
    return tuple(_effect(each, subject) for each in section_of(misfit, "effects", list, subject))


def _effect(plain: Any, subject: str) -> Effect:
    states = (*SHARES, VARIES, EARLY, BEGUN)
    if not isinstance(plain, dict) or plain.get("kind") not in LAWS or plain.get("state") not in states:
        refuse(subject, "effects of a known kind and state", "something else")
    if plain["kind"] not in {EARLY: ("thermal",), BEGUN: SHIFTS}.get(plain["state"], LAWS):
        refuse(subject, f"another state of {plain['kind']}", plain["state"])
    rows = section_of(plain, "spans_mm", list, subject)
    spans = np.array([numbers({"row": row}, "row", subject, 2) for row in rows])
    weights, absorbed = numbers(plain, "weights", subject, _MOST_WEIGHTS), numbers(plain, "absorbed", subject, 3)
    motor, period_mm = number(plain, "motor", subject), number(plain, "period_mm", subject)
    widths = {"two-motors": _MOST_WEIGHTS, "second-period": 2, "rail-play": 2, "rail-wave": 2}
    if spans.shape != (4, 2) or len(absorbed) != 3 or motor not in (0, 1) or period_mm <= 0:
        refuse(subject, "effects with a motor, a period and four spans", "something else")
    if len(weights) != widths.get(plain["kind"], 1) and not (plain["kind"] == "thermal" and len(weights) == 2):
        refuse(subject, f"the weights of {plain['kind']}", f"{len(weights)} numbers")
    detail, place = number(plain, "detail", subject), number(plain, "place", subject)
    if (plain["kind"] in ("creep", "second-period", "rail-wave") and detail <= 0) or detail < 0:
        refuse(subject, f"a positive detail of {plain['kind']}", f"{detail:g}")
    if plain["kind"] in ("halves", "halves-play", "rail-play", "rail-racking") and detail not in (0, 1):
        refuse(subject, f"an axis of {plain['kind']}", f"{detail:g}")
    if plain["kind"] == "rail-wave" and place not in (0, 1):
        refuse(subject, "an axis of rail-wave", f"{place:g}")
    way_mm = number(plain, "way_mm", subject, LONGEST_MM) if "way_mm" in plain else 0.0
    return Effect(
        plain["kind"], int(motor), weights, detail, place, plain["state"], absorbed, spans, period_mm, max(way_mm, 0.0)
    )


def _between(values_mm: np.ndarray, span_mm: np.ndarray) -> np.ndarray:
    low, high = float(span_mm[0]), float(span_mm[1])
    return np.asarray((2 * values_mm - low - high) / max(high - low, 1e-9))
