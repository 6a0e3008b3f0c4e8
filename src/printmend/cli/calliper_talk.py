"""Ask for calliper readings of distances, the most informative one next, and check every reading at once.

A map of the plate shows which dots to measure across.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from printmend.cli.terminal import spoken
from printmend.infer.distances import Guess, first_guess
from printmend.learn.by_hand import said_by_hand
from printmend.measure.callipers import (
    DOUBTED_SIGMAS,
    READING_SD_MM,
    Distances,
    distances_of,
    measurable_pairs,
    number_in,
)
from printmend.measure.image import write_image, write_words
from printmend.measure.plan import ProbePlan
from printmend.messages import Tell, say, together

PX_PER_MM = 8.0
MARGIN_MM = 12.0  # margin around the outermost dots
NUMBER_AT = np.linspace(0.1, 0.9, 17)  # shares of a line at which its number may stand
INK, CHOSEN = (70, 70, 70), (30, 90, 220)  # colours of dots and of distances, as (blue, green, red)


def draw_map(path: Path, distances: Distances, tell: Tell = str) -> None:
    """Draw every dot of the plate as seen from above, and a numbered line for each distance."""
    marks = distances.plan.marks_mm
    low, high = marks.min(axis=0) - MARGIN_MM, marks.max(axis=0) + MARGIN_MM
    width, height = np.ceil((high - low) * PX_PER_MM).astype(int)
    picture = np.full((height, width, 3), 250, np.uint8)

    def pixel(mm: np.ndarray) -> tuple[int, int]:
        return round((mm[0] - low[0]) * PX_PER_MM), round((high[1] - mm[1]) * PX_PER_MM)

    for mark, diameter in zip(marks, distances.plan.diameter_mm, strict=True):
        cv2.circle(picture, pixel(mark), round(diameter / 2 * PX_PER_MM), INK, -1, cv2.LINE_AA)
    placed = marks[distances.plan.big]  # a number stands off its ends, and as far as it can from those before it
    for number, (first, second) in enumerate(distances.pairs, start=1):
        cv2.line(picture, pixel(marks[first]), pixel(marks[second]), CHOSEN, 2, cv2.LINE_AA)
        along = marks[first] + NUMBER_AT[:, None] * (marks[second] - marks[first])
        at = max(along, key=lambda mm: np.hypot(*(placed - mm).T).min())
        placed = np.vstack([placed, at])
        cv2.putText(picture, str(number), pixel(at), cv2.FONT_HERSHEY_SIMPLEX, 1.1, CHOSEN, 3, cv2.LINE_AA)
    write_words(picture, tell(say("overlay-bed-front")), (20, height - 20), 32, INK)
    write_image(path, picture, dpi=PX_PER_MM * 25.4)


WIDE, TALL = 36, 12  # size of the plate's picture in characters
RARE_SHARE = 0.02  # a larger share of a distance is more likely a slip of the hand than the printer's error
LEAST_DOUBTED_MM = 1.5  # a smaller surprise is accepted: with few distances the prediction is often wrong by this
ENOUGH_SPREADS = 1.5  # a distance predicted within so many standard deviations of a reading is not worth measuring


def talk(
    plan: ProbePlan, ask: Callable[[str], str], show: Callable[[str], None], *, picture: Path | None = None
) -> tuple[Distances, np.ndarray]:
    """Ask for distances until the readings determine enough, or the owner stops; return distances and readings [K].

    ``ask`` puts a question and returns the answer (`EOFError` ends), ``show`` prints a message. Every distance is drawn
    into ``picture``. Raises `TraceError` for a plate too small for callipers.
    """
    pairs = measurable_pairs(plan)
    first = first_guess(plan, pairs)
    show(say("talk-help"))
    taken: list[tuple[int, float, bool]] = []
    skipped: list[int] = []
    doubted: float | None = None
    while True:
        guess = _known(first, plan, pairs, taken)
        used = [one for one, _, _ in taken] + skipped
        if len(used) == len(pairs):
            break
        best = guess.most_telling(used)
        spread = float(guess.spread_mm()[best])
        if taken and spread < ENOUGH_SPREADS * READING_SD_MM:
            show(say("talk-enough"))
            break
        here = distances_of(plan, pairs[[best]])
        if picture is not None:
            draw_map(picture, here, spoken)
        about = float(here.across_mm[0])
        show(_drawn(plan, pairs[best]))
        try:
            answer = ask(say("talk-question", len(taken) + 1, f"{about:.1f}")).strip().lower()
        except EOFError:
            break
        if answer in ("q", "quit", "end"):
            break
        if answer in ("u", "undo"):
            show(say("talk-taken-back", f"{taken.pop()[1]:g}") if taken else say("talk-nothing-to-take-back"))
        elif answer in ("?", "enough?", "enough"):
            _tell_estimates(plan, pairs, taken, show)
        elif not answer:
            skipped.append(best)
        else:
            inner = answer.startswith("i")
            wanted = _commanded_mm(plan, pairs, best, inner)
            value = number_in(answer.removeprefix("i"), wanted)
            fits = wanted + float(guess.row(best, inner=inner) @ guess.mean)
            if value is None:
                show(say("talk-no-number", repr(answer), say("talk-help")))
            elif doubted != value and (words := _doubt(value, wanted, fits, spread, bool(taken))):
                doubted = value
                show(words)
            else:
                taken.append((best, value, inner))
    distances = distances_of(
        plan, pairs[[one for one, _, _ in taken]], np.array([inner for _, _, inner in taken], bool)
    )
    return distances, np.array([value for _, value, _ in taken])


def _doubt(value: float, wanted: float, fits: float, spread: float, later: bool) -> str:
    """Say why a reading is doubted; return "" if it is not.

    ``wanted`` is the commanded distance, ``fits`` the one that the readings so far predict [mm], ``spread`` [mm] its
    uncertainty from faults. ``later`` says that there are readings so far.
    """
    off = abs(value - fits)
    unexplained = off > DOUBTED_SIGMAS * np.hypot(spread, READING_SD_MM)
    if off <= LEAST_DOUBTED_MM or (not unexplained and off <= RARE_SHARE * wanted):
        return ""
    if abs(value * 25.4 / wanted - 1) < 0.1:
        return say("talk-inches")
    if later:
        return say("talk-unlike-the-others", f"{off:.1f}")
    if unexplained:
        return say("talk-unexplained", f"{off:.1f}")
    return say("talk-unlikely", f"{off:.1f}", f"{100 * off / wanted:.0f}")


def _commanded_mm(plan: ProbePlan, pairs: np.ndarray, one: int, inner: bool) -> float:
    across = float(distances_of(plan, pairs[[one]]).across_mm[0])
    return across - (2 * plan.big_dot_mm if inner else 0.0)


def _known(first: Guess, plan: ProbePlan, pairs: np.ndarray, taken: list[tuple[int, float, bool]]) -> Guess:
    """Return the guess about the machine after the readings."""
    guess = first
    for one, value, inner in taken:
        guess = guess.after(one, value - _commanded_mm(plan, pairs, one, inner), inner=inner)
    return guess


def _tell_estimates(
    plan: ProbePlan, pairs: np.ndarray, taken: list[tuple[int, float, bool]], show: Callable[[str], None]
) -> None:
    if not taken:
        show(say("talk-nothing-yet"))
        return
    rows = [one for one, _, _ in taken]
    distances = distances_of(plan, pairs[rows], np.array([inner for _, _, inner in taken], bool))
    readings_mm = np.array([value for _, value, _ in taken])
    for line in said_by_hand(distances, readings_mm):
        show(line)


def _drawn(plan: ProbePlan, pair: np.ndarray) -> str:
    """Return a picture of the plate in characters, seen from above; on most printers, home is at the lower left."""
    marks = plan.marks_mm
    low, high = marks.min(axis=0), marks.max(axis=0)
    rows = [["·" if (x + y) % 2 else " " for x in range(WIDE)] for y in range(TALL)]
    for letter, mark in zip("AB", pair, strict=True):
        x, y = (marks[mark] - low) / np.maximum(high - low, 1e-9)
        rows[TALL - 1 - round(float(y) * (TALL - 1))][round(float(x) * (WIDE - 1))] = letter
    (x0, y0), (x1, y1) = marks[pair[0]], marks[pair[1]]
    frame = ["+" + "-" * WIDE + "+", *("|" + "".join(row) + "|" for row in rows), "+" + "-" * WIDE + "+"]
    dots = say("talk-dots", *(f"{each:.0f}" for each in (x0, y0, x1, y1)))
    return together("\n", [*frame, dots])
