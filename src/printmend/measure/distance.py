"""Settle the scale of a scan with callipers: by one distance on a probe, or by the widths of a part.

An instrument stretches a length at the angle θ on the bed by c + d cos 2θ + s sin 2θ. Here c is its common scale, d
half the difference between its axes, and s half their lean. One length gives one equation for these three unknowns;
the instrument's uncertainties serve as priors.

Flat jaws touch the outermost places of a part in a direction. A width is only asked for if walls lie there, not
corners: corners carry blobs, and no ray finds them.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from printmend.errors import TraceError
from printmend.measure.plan import ProbePlan
from printmend.measure.ruler import Ruler
from printmend.measure.walls import RASTER_MM, Walls
from printmend.messages import Said, is_one_of, say, say_large, together
from printmend.path import RESIZED, Instrument

LONGEST_ASKED_MM, SHORTEST_ASKED_MM = 145.0, 40.0  # limits of a distance to ask for: common callipers open 150 mm
READING_MM = 0.06  # standard deviation of a reading: the callipers, the hand, the rims of two dots
SLIP_MM = 2.0  # standard deviation of a slip: a line of the scale misread, jaws on another edge
SLIP_SHARE = RESIZED_SHARE = 0.02  # of readings, and of pictures of another size than they say (priors.toml, `resized`)
DOUBTED_SHARE = 0.5  # of pictures of another size among those that do not state theirs, or were resized since
SLIPPED = 0.5  # chance of a slip above which an owner is asked to measure again
MOST_SCALE_SHARE = 0.02  # a distance that is off by more is another one, if the picture's scale is known
UNIT_SHARE = 0.05  # a length that fits another unit to within this share is taken to be in that unit

_SIDES = (  # messages, by thirds of a plate
    ("front-left", "front", "front-right"), ("left", "middle", "right"), ("back-left", "back", "back-right"),
)  # fmt: skip
_OPEN = {  # messages
    "sheet": "scale-of-sheet", "paper": "scale-of-paper", "scanner": "scale-of-scanner", "picture": "scale-of-picture",
}  # fmt: skip
_SOURCE = {  # the message of a picture's scale: what the scale came from
    "scale-axes-from-tags": "sheet", "scale-from-tags": "sheet", "perspective-lens-from-tags-fit-mm": "sheet",
    "perspective-scale-from-edges-paper-straight": "paper", "scale-from-dpi-resized": "picture",
}  # fmt: skip
ASKING = (*_OPEN.values(), "widths-asked", "width-asked")  # messages that ask an owner for a distance


def choose_span(plan: ProbePlan, measured_mm: np.ndarray) -> tuple[int, int] | None:
    """Return the numbers of the two large dots farthest apart within the callipers' reach, or None."""
    found = np.flatnonzero(plan.big & np.isfinite(measured_mm).all(axis=1))
    marks = plan.marks_mm
    spans = [
        (length, one, other)
        for one, other in itertools.combinations(found.tolist(), 2)
        if plan.sheet_of[one] == plan.sheet_of[other]
        and SHORTEST_ASKED_MM <= (length := math.dist(marks[one], marks[other])) <= LONGEST_ASKED_MM
    ]
    if not spans:
        return None
    _, one, other = max(spans)
    return one, other


def open_scale(scale: str, *, ruled: bool = False) -> str:
    """Return words for where a picture's ``scale`` came from, and what would settle it. With a ruler in the picture
    (``ruled``), only the scale across it is open."""
    name = _OPEN[source_of(scale)]
    return say(f"open-{name}-across") if ruled else say(f"open-{name}")


def source_of(scale: str) -> str:
    """Return what a picture's scale came from, by its message: "sheet" (of tags), "paper", "picture" (that was
    resized), or "scanner"."""
    return _SOURCE.get(scale.id, "scanner") if isinstance(scale, Said) else "scanner"


def is_asking(note: str) -> bool:
    """Return whether a measurement's note asks the owner for a distance."""
    return is_one_of(note, ASKING)


def asked(plan: ProbePlan, span: tuple[int, int], across_mm: float, scale: str) -> str:
    """Say which distance, of about ``across_mm``, would settle the scale; ``scale`` says where it came from."""
    one, other = (
        say("dot-x-y", at, side_of(plan, at), f"{plan.marks_mm[at, 0]:.0f}", f"{plan.marks_mm[at, 1]:.0f}")
        for at in span
    )
    if len(plan.sheets) > 1:
        other = say("dot-of-sheet", other, plan.sheet_of[span[0]] + 1)
    return say(_OPEN[source_of(scale)], one, other, f"{across_mm:.0f}")


def side_of(plan: ProbePlan, mark: int) -> str:
    """Return a mark's place on the plate as seen from the front: "back right", "middle"."""
    marks = plan.marks_mm[plan.sheet_of == plan.sheet_of[mark]]
    low, high = marks.min(axis=0), marks.max(axis=0)
    third = np.clip(3 * (plan.marks_mm[mark] - low) / np.maximum(high - low, 1e-9), 0, 2).astype(int)
    return say(_SIDES[third[1]][third[0]])


def scaled_by(
    distance_mm: float, span: tuple[int, int], dots_mm: np.ndarray, measured_mm: np.ndarray, instrument: Instrument,
    scale: str = "",
) -> tuple[np.ndarray, Instrument, Said]:  # fmt: skip
    """Return the marks [M, 2] at the callipers' scale, the instrument with what remains uncertain, and a note.

    ``dots_mm`` [2] are the widths of the two dots in the image; ``scale`` says where its scale came from. Raises
    `TraceError` for the distance of other dots.
    """
    one, other = measured_mm[list(span)]
    seen = math.dist(one, other) + float(np.mean(dots_mm))
    excess = seen / distance_mm - 1.0  # by which share lengths in the image are too long
    if not abs(excess) <= _most_share(instrument):
        raise TraceError(
            say("distance-option"), wanted=say("about-mm-from-dot-dot-outer", f"{seen:.2f}", span[0], span[1]),
            came=together("", [f"{distance_mm:g}", inches(distance_mm, seen)]),
            todo=_retake(scale),
        )  # fmt: skip
    angle = math.atan2(other[1] - one[1], other[0] - one[0])
    stretch, left, note = settled(excess, angle, distance_mm, instrument)
    middle = np.nanmean(measured_mm, axis=0)
    return (measured_mm - middle) @ np.linalg.inv(stretch).T + middle, left, note


def scaled_by_rulers(
    rulers: Sequence[tuple[Ruler, np.ndarray]], places_mm: np.ndarray, instrument: Instrument
) -> tuple[np.ndarray, Instrument, list[str]]:
    """Return bed places [N, 2] at the scale of the rulers, the instrument with what remains uncertain, and notes.

    Each ruler comes with the matrix [2, 2] that turns its picture onto the bed.
    """
    if not rulers:
        return places_mm, instrument, []
    notes: list[str] = []
    taken = np.eye(2)
    for ruler, matrix in rulers:
        seen = ruler.on_bed(matrix).stretched(taken)
        angle = math.atan2(seen.along[1], seen.along[0])
        stretch, instrument, note = settled(
            seen.excess, angle, seen.length_mm, instrument, reading_mm=seen.sd * seen.length_mm, slip_share=0.0
        )
        taken = stretch @ taken
        large, known = say_large(ruler.excess), note.values["b"]
        notes.append(say("image-too-large-by-ruler", ruler.lines, f"{ruler.length_mm:.0f}", large, known))
    middle = np.nanmean(places_mm, axis=0)
    return (places_mm - middle) @ np.linalg.inv(taken).T + middle, instrument, notes


def _most_share(instrument: Instrument) -> float:
    """Return by which share a distance that was asked for may be off: by that of others, and by two standard deviations
    of the picture's scale."""
    return MOST_SCALE_SHARE + 2 * (instrument.scale_sd + instrument.resized_sd)


def _retake(scale: str) -> str:
    """Say what to do about a distance that cannot be right in a picture with this ``scale``."""
    return say("take-unresized-picture" if source_of(scale) == "picture" else "measure-again-in-mm")


def _row(angle_rad: float) -> np.ndarray:
    """Return the derivative of a length at an angle by scale, by half the axes' difference, and by half their lean."""
    return np.array([1.0, math.cos(2 * angle_rad), math.sin(2 * angle_rad)])


def settled(
    excess: float, angle_rad: float, distance_mm: float, instrument: Instrument, *, reading_mm: float = READING_MM,
    slip_share: float = SLIP_SHARE,
) -> tuple[np.ndarray, Instrument, Said]:  # fmt: skip
    """Return an image's stretch [2, 2], the instrument with what remains uncertain, and a note, after one length at an
    angle came out too long by the share ``excess``. ``reading_mm`` is the standard deviation of the reading.

    Either the instrument is as it says, or its picture is of another size, or the reading slipped: their mean and
    covariance hold by how likely each makes the excess.
    """
    row, plain, usual = _row(angle_rad), instrument.covariance, (reading_mm / distance_mm) ** 2
    resized = plain + np.diag([RESIZED.resized_sd**2, 0.0, 0.0])
    other = DOUBTED_SHARE if instrument.resized_sd else RESIZED_SHARE
    shares = np.array([1.0 - other, other, slip_share])
    cases = ((plain, usual), (resized, usual), (plain, usual + (SLIP_MM / distance_mm) ** 2))
    spreads = np.array([row @ prior @ row + noise for prior, noise in cases])
    with np.errstate(divide="ignore"):  # what never happens
        logs = np.log(shares) - (excess**2 / spreads + np.log(spreads)) / 2
    likely = np.exp(logs - logs.max())
    likely /= likely.sum()
    gains = [prior @ row / spread for (prior, _), spread in zip(cases, spreads, strict=True)]
    mean = excess * (likely @ gains)
    left = sum(
        share * (prior - np.outer(gain, row @ prior) + np.outer(gain * excess - mean, gain * excess - mean))
        for share, (prior, _), gain in zip(likely, cases, gains, strict=True)
    )
    common, half, lean = mean
    sds = np.sqrt(np.diag(left))
    stretch = np.array([[1 + common + half, lean], [lean, 1 + common - half]])
    note = say("image-too-large-by-callipers", say_large(excess), f"{100 * math.sqrt(row @ left @ row):.2f}")
    if likely[2] > SLIPPED:
        note = say("warning", say("image-scale-strange", say_large(excess), f"{distance_mm * (1 + excess):.2f}"))
    together = left / np.maximum(np.outer(sds, sds), 1e-18)
    known = replace(
        instrument, scale_sd=float(sds[0]), axes_sd=float(sds[1]), lean_sd=float(sds[2]),
        scale_axes=float(together[0, 1]), scale_lean=float(together[0, 2]), axes_lean=float(together[1, 2]),
        resized_sd=0.0,
    )  # fmt: skip
    return stretch, known, note


def inches(given_mm: float, wanted_mm: float) -> str:
    """Return a note if a length seems to be in inches or centimetres, where about ``wanted_mm`` was expected; otherwise
    an empty string."""
    for message, unit_mm in (("looks-like-inches", 25.4), ("looks-like-cm", 10.0)):
        if abs(given_mm * unit_mm / wanted_mm - 1) < UNIT_SHARE:
            return say(message)
    return ""


SHORTEST_WIDTH_MM = 25.0  # shortest width that callipers are asked for
WIDTH_READING_MM = 0.03  # standard deviation of a reading over walls that the jaws lie flat on
LEAST_FACING = math.cos(math.radians(12.0))  # a wall with a normal this near to the width lies flat on a jaw
OUTERMOST_MM = 0.15  # wall places this near to the outermost one touch the jaw, too
MOST_WIDTHS = 2  # most widths to ask for
LEAST_TURN_SINE = math.sin(math.radians(44.0))  # two widths less than 44° apart say nearly the same
ANGLES_DEG = (0, 90, 45, 135, 15, 30, 60, 75, 105, 120, 150, 165)  # directions of widths, from X


@dataclass(frozen=True, eq=False)
class Width:
    """A direction [rad] from X, and the numbers of the wall places that lie outermost on either side."""

    angle_rad: float
    ends: tuple[np.ndarray, np.ndarray]

    @property
    def words(self) -> str:
        """The direction, for the owner."""
        degrees = round(math.degrees(self.angle_rad))
        named = {0: "across-part-along-x", 90: "across-part-along-y"}
        return say(named[degrees]) if degrees in named else say("across-part-at-angle", degrees)

    def across_mm(self, edge_mm: np.ndarray) -> float:
        """Return the width between edges [S, 2] mm."""
        along = edge_mm @ _unit(self.angle_rad)
        return float(along[self.ends[0]].max() - along[self.ends[1]].min())


def choose_widths(walls: Walls) -> tuple[Width, ...]:
    """Return up to two widths that callipers can take: first those along X and Y, then the longer ones.

    Two, because one width says nothing about the scanner's other axis.
    """
    outline, _ = cv2.findContours(walls.plastic.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(np.vstack(outline))[:, 0] * RASTER_MM + walls.corner_mm
    edge = walls.commanded_mm[walls.row] + walls.half_mm[:, None] * walls.normal
    found: list[tuple[bool, float, Width]] = []
    for degrees in ANGLES_DEG:
        unit = _unit(math.radians(degrees))
        along, facing = edge @ unit, walls.normal @ unit
        high, low = float((hull @ unit).max()), float((hull @ unit).min())
        ends = (
            np.flatnonzero((facing > LEAST_FACING) & (along > high - OUTERMOST_MM)),
            np.flatnonzero((facing < -LEAST_FACING) & (along < low + OUTERMOST_MM)),
        )
        if min(map(len, ends)) and SHORTEST_WIDTH_MM <= high - low <= LONGEST_ASKED_MM:
            found.append((degrees in (0, 90), high - low, Width(math.radians(degrees), ends)))
    chosen: list[Width] = []
    for _, _, width in sorted(found, key=lambda one: one[:2], reverse=True):
        if all(abs(math.sin(width.angle_rad - one.angle_rad)) > LEAST_TURN_SINE for one in chosen):
            chosen.append(width)
    return tuple(chosen[:MOST_WIDTHS])


def widths_asked(widths: Sequence[Width], edge_mm: np.ndarray, scale: str, *, ruled: bool = False) -> str:
    """Say which widths would settle the scale; ``scale`` says where it came from. ``edge_mm`` [S, 2] is where the image
    shows the walls."""
    said = together(" / ", [say("width-about", width.words, f"{width.across_mm(edge_mm):.0f}") for width in widths])
    return say("width-asked" if len(widths) == 1 else "widths-asked", open_scale(scale, ruled=ruled), said)


def scaled_by_widths(
    distances_mm: Sequence[float], widths: Sequence[Width], edge_mm: np.ndarray, instrument: Instrument,
    scale: str = "",
) -> tuple[np.ndarray, Instrument, str]:  # fmt: skip
    """Return the map [2, 2] from the image's scale to the callipers', the instrument with what remains uncertain, and a
    note.

    ``edge_mm`` [S, 2] is where the image shows the walls; ``scale`` says where its scale came from. Raises `TraceError`
    for widths of another part.
    """
    if len(distances_mm) > len(widths):
        raise TraceError(
            say("distance-option"), wanted=say("so-many-widths", len(widths)),
            came=str(len(distances_mm)), todo=say("leave-others-out-scan-own-scale"),
        )  # fmt: skip
    begun, onto, notes = edge_mm, np.eye(2), []
    for distance_mm, width in zip(distances_mm, widths, strict=False):
        seen = width.across_mm(edge_mm)
        excess = seen / distance_mm - 1.0
        if not abs(excess) <= _most_share(instrument):
            raise TraceError(
                say("distance-option"), wanted=say("about-mm", f"{width.across_mm(begun):.2f}", width.words),
                came=together("", [f"{distance_mm:g}", inches(distance_mm, seen)]), todo=_retake(scale),
            )  # fmt: skip
        stretch, instrument, note = settled(
            excess, width.angle_rad, distance_mm, instrument, reading_mm=WIDTH_READING_MM
        )
        notes.append(together(": ", [width.words, note]))
        onto = np.linalg.inv(stretch) @ onto
        edge_mm = mapped(begun, onto)
    return onto, instrument, together("; ", notes)


def mapped(edge_mm: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Apply a map [2, 2] to places [S, 2] mm, about their middle."""
    middle = edge_mm.mean(axis=0)
    return np.asarray((edge_mm - middle) @ onto.T + middle)


def _unit(angle_rad: float) -> np.ndarray:
    return np.array([math.cos(angle_rad), math.sin(angle_rad)])
