"""Combine the scans of one print: remove the scanner's own axes, and give every mark its standard deviation."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from printmend.errors import ScanError
from printmend.measure.distance import asked, choose_span, scaled_by, scaled_by_rulers, source_of
from printmend.measure.identity import SYMMETRIES
from printmend.measure.image import with_legend, write_image
from printmend.measure.marks import find_pose, turn_onto
from printmend.measure.plan import LEAST_SHARED, ProbePlan, read_plan
from printmend.measure.scan import Reading, affine_of, image_px, mean_motion, motion_of, read_scan
from printmend.messages import Tell, say
from printmend.path import FLATBED, Instrument, Motion, Trace, distorted
from printmend.units import MM_PER_INCH

# Align scans: of one print turned on the glass, of its parts, or of sheets that show the same marks.

LEAST_TURN_SINE = 0.35  # least |sin| of the turn between two scans at which they separate the scanner's axes
LEAST_SPREAD_SHARE = 0.25  # share of the pattern over which the marks that join two scans must spread
TURN_ROUNDS = 12  # how often every scan is turned onto the mean of all


def shared_number(plan: ProbePlan) -> np.ndarray:
    """Return a number [M] for each mark; marks of several sheets at the same place share one."""
    if len(plan.sheets) == 1:
        return np.arange(len(plan))
    return np.unique(plan.site, axis=0, return_inverse=True)[1].ravel()


def check_sheets(readings: Sequence[Reading], plan: ProbePlan) -> None:
    """Raise `ScanError` where a sheet is missing."""
    shown = {reading.sheet + 1 for reading in readings}
    missing = sorted(set(range(1, len(plan.sheets) + 1)) - shown)
    if missing:
        raise ScanError(
            readings[0].path, wanted=say("scans-all-sheets-print", len(plan.sheets)),
            came=say("none-sheet", " and ".join(map(str, missing))), todo=say("name-scans-all-them"),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Freed:
    """The scans [K × [S, 2]] of one print without the errors of their scanner: of its lens, its carriage and its
    ``axes`` [2, 2], the linear map that it makes of equal and square ones. ``instrument`` is what remains of it.
    ``settled`` says that the scans were turned far enough to show the axes."""

    places_mm: tuple[np.ndarray, ...]
    axes: np.ndarray
    instrument: Instrument
    notes: tuple[str, ...]
    settled: bool


def freed_of_scanner(places_mm: Sequence[np.ndarray] | np.ndarray, instrument: Instrument) -> Freed:
    """Take off what the scans of one print show of their scanner. Places count from the middle of their picture.

    The lens shifts places along the picture's width, the carriage along its height, both by low powers of the place,
    and its axes differ and lean: f(q) = F(q)·c. A turn R links two scans, so q₂ − R·q₁ = F(q₂)·c − R·F(q₁)·c but for
    how the print lay, and its scale. Least squares give c, with a ridge by the instrument's uncertainty. A half turn
    says nothing of the axes.
    """
    if len(places_mm) == 1:
        return Freed(tuple(places_mm), np.eye(2), instrument, (), settled=False)
    sds = np.repeat([instrument.lens_mm, instrument.carriage_mm, instrument.axes_sd, instrument.lean_sd], [3, 3, 1, 1])
    rows, sines = [np.empty((0, len(sds) + 1))], [0.0]
    for other in places_mm[1:]:
        both = _shared(places_mm[0], other)
        first, second = places_mm[0][both], other[both]
        if len(first) < LEAST_SHARED:
            continue
        turn = turn_onto(first, second)
        laid = first @ turn + (second - first @ turn).mean(axis=0)
        columns = (_own(laid) - turn.T @ _own(first)) * sds
        found = np.concatenate([columns, (second - laid)[:, :, None]], axis=2).reshape(2 * len(first), -1)
        shifts, turned = np.broadcast_to(np.eye(2), (len(laid), 2, 2)), laid[:, ::-1] * [-1.0, 1.0]
        free = np.concatenate([shifts, np.stack([laid, turned], axis=2)], axis=2).reshape(2 * len(first), -1)
        rows.append(found - free @ np.linalg.lstsq(free, found, rcond=None)[0])
        sines.append(abs(float(turn[0, 1])))
    table, seen = np.split(np.vstack(rows), [-1], axis=1)
    noise = seen - table @ np.linalg.lstsq(table, seen, rcond=None)[0]
    variance = float(np.mean(np.append(noise, LEAST_DISAGREEMENT_MM) ** 2))
    inverse = np.linalg.inv(table.T @ table + variance * np.eye(len(sds)))
    *bends, even, skew = sds * (inverse @ table.T @ seen)[:, 0]
    moved = [_own(place)[..., :6] @ bends for place in places_mm]
    left_mm = instrument.lens_mm * math.sqrt(variance * np.diag(inverse)[:3].max())
    settled, axes = max(sines) >= LEAST_TURN_SINE, np.eye(2)
    notes = [say("scans-not-turned-quarter-scanner-s")]
    if settled:
        axes = axes + np.array([[even, skew], [skew, -even]])
        notes = [say("scanner-s-axes-differ-lean-removed", f"{200 * even:+.2f}", f"{np.degrees(2 * skew):+.3f}")]
        if instrument.lens_mm:
            most_mm = np.nanmax(np.hypot(*moved[0].T))
            notes.insert(0, say("scanner-lens-removed", f"{most_mm:.3f}", f"{left_mm:.3f}"))
    places = [(place - by) @ np.linalg.inv(axes).T for place, by in zip(places_mm, moved, strict=True)]
    return Freed(tuple(places), axes, replace(instrument, lens_mm=left_mm), tuple(notes), settled)


def _own(off_mm: np.ndarray) -> np.ndarray:
    """Return how a scanner's lens, its carriage and its axes shift places [N, 2] of a picture, as [N, 2, 8]."""
    linear = np.stack([off_mm * [1.0, -1.0], off_mm[:, ::-1]], axis=2)
    return np.concatenate([distorted(off_mm, 0), distorted(off_mm, 1), linear], axis=2)


def aligned(place: np.ndarray, first: np.ndarray, reading: Reading) -> np.ndarray:
    """Turn and shift the marks [M, 2] of a further scan onto the first's; the common marks fix this best."""
    upright = place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
    both = np.isfinite(upright).all(axis=1) & np.isfinite(first).all(axis=1)
    turned = upright @ turn_onto(upright[both], first[both])
    return turned + np.median((first - turned)[both], axis=0)


def joined(places: Sequence[np.ndarray], readings: Sequence[Reading], plan: ProbePlan) -> tuple[list[np.ndarray], str]:
    """Join scans that show parts of one print: return them [K × [S, 2]] on the bed, and how well shared marks agree.

    Every scan is turned and shifted onto the mean of all, repeatedly: least squares over all scans at once.
    Raises `ScanError` for a scan that shares too few marks with the others.
    """
    upright = [
        place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
        for place, reading in zip(places, readings, strict=True)
    ]
    order = [int(np.argmax([np.isfinite(one[:, 0]).sum() for one in upright]))]
    laid: dict[int, np.ndarray] = {order[0]: upright[order[0]]}
    while len(laid) < len(upright):
        mean = mean_of(np.stack(list(laid.values())))
        left = [k for k in range(len(upright)) if k not in laid]
        best = max(left, key=lambda k: _shared(upright[k], mean).sum())
        _check_shared(_shared(upright[best], mean), readings[best], plan)
        laid[best] = _onto(upright[best], mean)
    for _ in range(TURN_ROUNDS):
        mean = mean_of(np.stack(list(laid.values())))
        laid = {k: _onto(one, mean) for k, one in laid.items()}
    stack = np.stack([laid[k] for k in range(len(upright))])
    mean = mean_of(stack)
    pose = find_pose(mean[shared_number(plan)] * np.array([1.0, -1.0]), plan, mirrored=False)
    both = np.isfinite(stack[..., 0]).sum(axis=0) > 1
    off = (stack - mean)[:, both]
    apart = float(np.sqrt(np.nanmean(np.sum(off**2, axis=2))))
    counts = (len(stack), len(plan.sheets)) if len(plan.sheets) > 1 else (len(stack),)
    message = "scans-sheets-joined-marks-they-share" if len(plan.sheets) > 1 else "scans-joined-marks-they-share-these"
    note = say(message, *counts, int(both.sum()), f"{apart:.3f}")
    return [pose.apply(one * np.array([1.0, -1.0])) for one in stack], note


def mean_of(stack: np.ndarray) -> np.ndarray:
    """Return the mean over the first axis, ignoring NaN; NaN where all are NaN."""
    known = np.isfinite(stack)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, stack, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _shared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1))


def _onto(one: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Turn and shift places [M, 2] onto others, robustly."""
    both = _shared(one, mean)
    turned = one @ turn_onto(one[both], mean[both])
    return turned + np.median((mean - turned)[both], axis=0)


def _check_shared(both: np.ndarray, reading: Reading, plan: ProbePlan) -> None:
    marks = plan.marks_mm[both[shared_number(plan)]]
    spread = np.ptp(marks, axis=0).max() if len(marks) else 0.0
    if both.sum() < LEAST_SHARED or spread < LEAST_SPREAD_SHARE * np.ptp(plan.marks_mm, axis=0).max():
        raise ScanError(
            reading.path, wanted=say("least-marks-another-scan-shows-too", LEAST_SHARED),
            came=f"{int(both.sum())}", todo=say("let-neighbouring-scans-overlap-third"),
        )  # fmt: skip


SETTLED_AXES_SD = 1e-4  # standard deviation (share) of the scanner's axes once two turns of the plate show them
WHOLE_SHARE = 0.85  # a scan with a smaller share of the marks shows a part of the print
MOST_APART_SIGMAS = 6.0  # a mark is left out if two scans see it farther apart than this: one of them saw dirt
SURE_SIGMAS = 1.645  # one-sided 95 % quantile of the normal distribution
SAME_PICTURE_PX = 5e-3  # two pictures whose dots differ by less (RMS) are one
LEAST_MARKS = 10  # fewest marks that two scans must share for a comparison
LEAST_DISAGREEMENT_MM = 0.01  # least RMS unevenness of scans to report: five times a flatbed's
OVERLAY_PX = 3000  # longer side of the overlay
ENLARGED = (1, 2, 5, 10, 20, 50)  # largest factor by which the overlay enlarges errors
# Colours of what is drawn: blue, green, red.
FOUND, MISSING, ERROR, RULER, ASKED = (60, 170, 60), (40, 40, 230), (230, 120, 30), (170, 30, 150), (200, 0, 200)


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured marks [M, 2] in the bed's frame, NaN where missing, with ``sigma_mm`` [M]; ``notes`` for the owner; the
    ``instrument``'s uncertainty along the bed's x and y. ``asked`` are the two marks whose distance would settle the
    scale, None if nothing is asked, and ``asked_mm`` is about how far apart their outer edges are. ``motion`` is how
    far the head strays by the lines at speed, None if there are none."""

    plan: ProbePlan
    measured_mm: np.ndarray
    sigma_mm: np.ndarray
    notes: tuple[str, ...]
    instrument: Instrument
    asked: tuple[int, int] | None = None
    asked_mm: float = 0.0
    motion: Motion | None = None

    @property
    def missing(self) -> np.ndarray:
        """The numbers of the marks that were not found."""
        return np.flatnonzero(np.isnan(self.measured_mm).any(axis=1) & ~(self.plan.pen & self.plan.big))

    @property
    def trace(self) -> Trace:
        traced = self.plan.trace(self.measured_mm, self.sigma_mm)
        return replace(traced, instrument=self.plan.seen_by(self.instrument), motion=self.motion)


def measure_scans(
    paths: str | Path | Sequence[str | Path],
    plan: ProbePlan | str | Path,
    *,
    dpi: float | None = None,
    overlay: Path | None = None,
    distance_mm: float | None = None,
    scanner_error: float | None = None,
    look: Callable[[Reading], None] | None = None,
    tell: Tell = str,
) -> Measurement:
    """Measure one print from one or more scans; draw what was found over the first into ``overlay``.

    ``plan`` is the plan that `write_probe` wrote beside the G-code, or its path. Learn from the result's ``trace``.
    ``distance_mm`` settles the scale: it is the distance between two dots by callipers, outer edge to outer edge. A
    measurement without it names the two dots. ``scanner_error`` is the standard deviation, as a share, of lengths in
    the scans if it is known; otherwise `FLATBED` holds. ``look`` receives the reading of the first scan with its image.
    ``tell`` translates the words on the overlay.

    Raises `ScanError` as `read_scan` does, and for the ``scanner_error`` of a picture whose scale is a sheet's;
    `TraceError` for a distance that cannot be theirs.
    """
    paths = [paths] if isinstance(paths, str | Path) else paths
    if not isinstance(plan, ProbePlan):
        plan = read_plan(plan)
    # many small matrices: threads of a linear-algebra library would only wait for each other
    with threadpool_limits(1, "blas"):
        return _measured(paths, plan, dpi, overlay, distance_mm, scanner_error, look, tell)


def _measured(
    paths: Sequence[str | Path], plan: ProbePlan, dpi: float | None, overlay: Path | None, distance_mm: float | None,
    scanner_error: float | None, look: Callable[[Reading], None] | None, tell: Tell,
) -> Measurement:  # fmt: skip
    drawn: list[Reading] = []
    wanted, wanted_mm = None, 0.0
    try:
        readings, notes, motion = _readings(paths, plan, dpi, look, None if overlay is None else drawn)
        if scanner_error is not None:
            readings = [replace(each, instrument=_known(each, scanner_error)) for each in readings]
        measured, sigma, instrument, said = _on_bed(readings, plan)
        notes += said
        if motion is not None:
            notes.append(motion_said(motion))
        cartesian = plan.kinematics == "cartesian"
        notes.append(say("position-turn-fitted-x-keeps" if cartesian else "position-turn-fitted-motors-share"))
        span = choose_span(plan, measured)
        if span is not None and distance_mm is not None:
            widths = [_among_all(_widths(reading), plan.sheet_of == reading.sheet) for reading in readings]
            dots_mm = mean_of(np.stack(widths))[list(span)]
            measured, instrument, note = scaled_by(distance_mm, span, dots_mm, measured, instrument, readings[0].scale)
            notes.append(note)
        elif span is not None and not any(reading.rulers for reading in readings):
            wanted, wanted_mm = span, math.dist(*measured[list(span)]) + float(plan.big_dot_mm)
            notes.append(asked(plan, span, wanted_mm, readings[0].scale))
    finally:  # also where a later scan cannot be read
        if overlay is not None and drawn:
            own = np.flatnonzero(plan.sheet_of == drawn[0].sheet).tolist()
            asked_for = tuple(map(own.index, wanted)) if wanted and {*wanted} <= {*own} else ()
            draw_overlay(overlay, drawn[0], asked_for, tell=tell)
    if plan.pen:  # a circle shows where the pen went round, not where it came to rest
        measured[plan.big], sigma[plan.big] = np.nan, np.nan
    return Measurement(plan, measured, sigma, tuple(notes), instrument, wanted, wanted_mm, motion)


def _readings(
    paths: Sequence[str | Path], plan: ProbePlan, dpi: float | None, look: Callable[[Reading], None] | None,
    drawn: list[Reading] | None,
) -> tuple[list[Reading], list[str], Motion | None]:  # fmt: skip
    """Return the scans' readings without images, a note for each, and the head's motion by the lines at speed;
    ``drawn`` receives the first reading with its image.

    A picture that was given twice counts once.
    """
    readings: list[Reading] = []
    notes: list[str] = []
    motions: list[Motion | None] = []
    for path in paths:
        reading = read_scan(path, plan, dpi=dpi)
        if (same := next((one for one in readings if is_same_picture(one, reading)), None)) is not None:
            notes.append(say("same-picture-counted-once-lay-print", path, same.path))
            continue
        if drawn is not None and not readings:
            drawn.append(reading)
        if look is not None and not readings:
            look(reading)
        motions.append(motion_of(reading))
        # keep the pixels of one scan at a time, and those of the first for the overlay
        readings.append(_without_image(reading))
        notes.append(_described(reading, several=len(plan.sheets) > 1))
    return readings, notes, mean_motion(motions)


def is_same_picture(one: Reading, other: Reading) -> bool:
    """Return whether two readings are of one picture, saved twice, turned by quarters or mirrored. No print is laid
    down twice at the same angle to a ten-thousandth of a degree, nor read twice without noise."""
    if one.sheet != other.sheet:
        return False
    both = one.marks.found & other.marks.found
    ours, theirs = (each.dots.centre_px[each.marks.match.dot[both]] for each in (one, other))
    if len(ours) < LEAST_MARKS:
        return False
    apart_px = [theirs - ours @ turn for turn in SYMMETRIES]
    return min(float(np.sqrt(np.mean((one - one.mean(axis=0)) ** 2))) for one in apart_px) < SAME_PICTURE_PX


def _known(reading: Reading, scanner_error: float) -> Instrument:
    """Return the uncertainty of a scanner whose owner knows how far lengths in its scans are off."""
    if source_of(reading.scale) != "scanner":
        raise ScanError(
            reading.path, wanted=say("scan-without-sheet"),
            came=reading.scale, todo=say("leave-option-out"),
        )  # fmt: skip
    return FLATBED.known(scanner_error)


def _on_bed(readings: Sequence[Reading], plan: ProbePlan) -> tuple[np.ndarray, np.ndarray, Instrument, list[str]]:
    """Return the marks [M, 2] on the bed, their standard deviations [M], the instrument's uncertainty, and notes."""
    number = shared_number(plan)
    mine = [plan.sheet_of == reading.sheet for reading in readings]
    pictures = np.full((len(readings), int(number.max()) + 1, 2), np.nan)
    for picture, reading, own in zip(pictures, readings, mine, strict=True):
        picture[number[own]] = reading.image_mm - reading.middle_mm
    freed = freed_of_scanner(pictures, readings[0].instrument)
    places, instrument, notes = freed.places_mm, freed.instrument, list(freed.notes)
    check_sheets(readings, plan)
    seen = [own & np.isfinite(place[number, 0]) for place, own in zip(places, mine, strict=True)]
    together = np.any(seen, axis=0)
    notes += missing_said(together, plan)
    pose = find_pose(
        np.where(mine[0][:, None], places[0][number], np.nan), plan, mirrored=readings[0].marks.match.mirrored
    )
    if len(plan.sheets) > 1 or min(int(one.sum()) for one in seen) < WHOLE_SHARE * together.sum():
        laid, note = joined(places, readings, plan)
        notes.append(note)
    else:
        first = pose.apply(places[0])
        others = zip(places[1:], readings[1:], strict=True)
        laid = [first, *(aligned(place, first, reading) for place, reading in others)]
    on_bed = [np.where(one[:, None], place[number], np.nan) for place, one in zip(laid, seen, strict=True)]
    sigmas = [_among_all(reading.sigma_mm, own) for reading, own in zip(readings, mine, strict=True)]
    measured, sigma = _merged(on_bed, sigmas)
    _, first = np.unique(number, return_index=True)
    wave_mm = wave_left_mm(laid, plan.marks_mm[first])
    instrument = replace(
        instrument, wave_mm=max(instrument.wave_mm, wave_mm), lens_mm=math.hypot(instrument.lens_mm, wave_mm)
    )
    matrices = [reading.marks.pose.matrix for reading in readings]
    instrument = instrument_on_bed(instrument, matrices, settled=freed.settled)
    if wave_mm > LEAST_DISAGREEMENT_MM:
        notes.append(say("scans-disagree-mm-where-dots-lie", f"{wave_mm:.3f}"))
    turned = zip(readings, matrices, strict=True)
    rulers = [(one.stretched(freed.axes), matrix) for reading, matrix in turned for one in reading.rulers]
    measured, instrument, said = scaled_by_rulers(rulers, measured, instrument)
    return measured, sigma, instrument, [*notes, *said]


def motion_said(motion: Motion) -> str:
    """Return a note of how far a moving head strays: as estimated, and at most."""
    square = max(motion.square_mm2, 0.0)
    most = math.sqrt(square + SURE_SIGMAS * motion.sd_mm2)
    return say("moving-head-strays", f"{math.sqrt(square):.3f}", f"{most:.3f}")


def missing_said(found: np.ndarray, plan: ProbePlan) -> list[str]:
    """Return a note where many of the marks [M] were not found: how many, and on which side of the bed."""
    if found.mean() >= WHOLE_SHARE:
        return []
    gone, middle = plan.marks_mm[~found].mean(axis=0), plan.marks_mm.mean(axis=0)
    axis = int(np.argmax(np.abs(gone - middle)))
    side = say((("left", "right"), ("front", "back"))[axis][int(gone[axis] > middle[axis])])
    return [say("marks-missing-at-side", int((~found).sum()), len(plan), side)]


def _among_all(values: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Spread the values of the marks ``own`` [M] over all marks, NaN for the others."""
    every = np.full(len(own), np.nan)
    every[own] = values
    return every


def wave_left_mm(on_bed: Sequence[np.ndarray], marks_mm: np.ndarray) -> float:
    """Estimate from the scans' disagreement how uneven their mean [K × [S, 2]] still is (RMS of one coordinate).

    All scans show the same print. Reading errors are independent from mark to mark; an uneven carriage moves
    neighbours alike. So the covariance between neighbours of the difference of two scans is twice the variance of one
    scan's unevenness, and four times that of the mean of two.
    """
    found = [0.0]
    for other in on_bed[1:]:
        apart = on_bed[0] - other
        both = np.isfinite(apart).all(axis=1)
        if both.sum() < LEAST_MARKS:
            continue
        apart = apart[both] - apart[both].mean(axis=0)
        _, near = cKDTree(marks_mm[both]).query(marks_mm[both], k=2)
        found.append(float((apart * apart[near[:, 1]]).sum(axis=1).mean()) / 2)
    shown = np.isfinite(np.stack(on_bed)[..., 0])
    scans = shown.sum() / max(shown.any(axis=0).sum(), 1)  # of a mark: sheets share few
    return math.sqrt(max(max(found), 0.0) / (2 * scans))


def instrument_on_bed(instrument: Instrument, matrices: Sequence[np.ndarray], *, settled: bool) -> Instrument:
    """Return an instrument's uncertainty along the bed's axes, whose pictures [K × [2, 2]] lie turned on it. If
    ``settled``, two turns of the plate have shown its own axes, and its carriage makes no larger waves than those in
    which the scans disagree."""
    turns = [float(np.arctan2(matrix[0, 1], matrix[0, 0])) for matrix in matrices]
    upright, lying = ([each for each in turns if (math.cos(2 * each) < 0) is lies] for lies in (False, True))
    x, y = (math.remainder((own or turns)[0], math.pi / 2) for own in (lying, upright))
    instrument = replace(instrument, turn_x_rad=x, turn_y_rad=y)
    if settled:
        return replace(instrument, axes_sd=SETTLED_AXES_SD, lean_sd=SETTLED_AXES_SD, carriage_mm=instrument.wave_mm)
    c, s = np.cos(2 * turns[0]), np.sin(2 * turns[0])
    axes, lean = instrument.axes_sd, instrument.lean_sd
    return replace(instrument, axes_sd=float(np.hypot(c * axes, s * lean)), lean_sd=float(np.hypot(s * axes, c * lean)))


def _widths(reading: Reading) -> np.ndarray:
    """Return the diameters of the marks' dots as the image shows them [M] mm, NaN where missing."""
    widths, found = np.full(len(reading.marks.found), np.nan), reading.marks.found
    widths[found] = reading.dots.diameter_px[reading.marks.match.dot[found]] * reading.mm_per_px
    return widths


def _merged(on_bed: list[np.ndarray], sigmas: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Average the scans [K × [M, 2]], weighted; drop marks on which they disagree."""
    places, sigma = np.stack(on_bed), np.stack(sigmas)
    if len(places) == 1:
        return places[0], sigma[0]
    weight = np.where(np.isfinite(sigma), 1.0 / sigma**2, 0.0)
    total = weight.sum(axis=0)
    mean = np.where(total > 0, 1, np.nan)[:, None] * (
        np.nansum(weight[..., None] * places, axis=0) / np.maximum(total, 1e-12)[:, None]
    )
    merged = np.where(total > 0, 1.0 / np.sqrt(np.maximum(total, 1e-12)), np.nan)
    off = np.abs(places - mean).max(axis=2) / np.maximum(sigma, 1e-9)
    usual = max(float(np.nanmedian(off)), 1.0)
    apart = np.nan_to_num(off).max(axis=0) > MOST_APART_SIGMAS * usual
    mean[apart], merged[apart] = np.nan, np.nan
    return mean, merged


def _described(reading: Reading, *, several: bool) -> str:
    found, total = int(reading.marks.found.sum()), len(reading.marks.found)
    match, matrix = reading.marks.match, reading.marks.pose.matrix
    upright = np.diag([-1.0 if match.mirrored else 1.0, -1.0]) @ matrix
    turned = np.degrees(np.arctan2(upright[0, 1], upright[0, 0]))
    turn = f"{-turned:.1f}"
    if several:
        name = "marks-read-below-of-sheet" if match.mirrored else "marks-read-of-sheet"
        return say(name, reading.path, found, total, reading.sheet + 1, turn, reading.scale)
    name = "marks-read-below" if match.mirrored else "marks-read"
    return say(name, reading.path, found, total, turn, reading.scale)


def _without_image(reading: Reading) -> Reading:
    return replace(reading, image=np.broadcast_to(np.uint8(0), reading.image.shape))


def draw_overlay(path: Path, reading: Reading, asked: tuple[int, ...] = (), *, tell: Tell = str) -> None:
    """Draw found marks as rings, missing ones as crosses, and the error of each mark as an enlarged line. Join the two
    marks whose distance is ``asked`` for."""
    factor = min(1.0, OVERLAY_PX / max(reading.image.shape[:2]))
    picture = cv2.resize(reading.image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    plan, found = reading.plan, reading.marks.found
    to_px = affine_of(reading.dots_mm, reading.dots.centre_px)

    def pixel(bed_mm: np.ndarray) -> np.ndarray:
        return np.rint(((image_px(reading, bed_mm) + 0.5) * factor - 0.5) * 16).astype(int)

    measured = reading.marks.measured_mm
    error = np.nan_to_num(measured - plan.marks_mm)
    usual = float(np.quantile(np.hypot(*error[found].T), 0.95)) + 1e-6
    enlarged = max((k for k in ENLARGED if k * usual <= plan.pitch_mm), default=1)
    at, ends = pixel(np.nan_to_num(measured)), pixel(np.nan_to_num(measured) + enlarged * error)
    wanted = pixel(reading.marks.expected_mm)
    scale = float(np.sqrt(abs(np.linalg.det(to_px[:2])))) * factor
    thick = max(1, round(0.12 * scale))
    for mark in range(len(plan)):
        if found[mark]:
            radius = int((0.5 * plan.diameter_mm[mark] + 0.35) * scale * 16)
            cv2.circle(picture, at[mark].tolist(), radius, FOUND, thick, cv2.LINE_AA, 4)
            cv2.line(picture, at[mark].tolist(), ends[mark].tolist(), ERROR, thick, cv2.LINE_AA, 4)
        else:
            place = (wanted[mark] // 16).tolist()
            cv2.drawMarker(picture, place, MISSING, cv2.MARKER_TILTED_CROSS, int(2 * scale) + 3, 2 * thick)
    two = at[list(asked)] if asked and found[list(asked)].all() else at[:0]
    for place in two:
        cv2.circle(picture, place.tolist(), int(0.45 * plan.pitch_mm * scale * 16), ASKED, 3 * thick, cv2.LINE_AA, 4)
    cv2.polylines(picture, [two], False, ASKED, 2 * thick, cv2.LINE_AA, 4)
    for ruler in reading.rulers:
        corners = np.rint((ruler.corners_mm / reading.mm_per_px * factor) * 16).astype(int)
        cv2.polylines(picture, [corners], True, RULER, 2 * thick, cv2.LINE_AA, 4)
    lost = int((~found).sum())
    shown = say("draw-true-to-scale") if enlarged == 1 else say("overlay-enlarged", enlarged)
    items = [
        (say("overlay-found", int(found.sum()), len(found)), FOUND),
        (say("overlay-off", shown), ERROR),
        *([(say("overlay-missing", lost), MISSING)] if lost else []),
        *([(say("overlay-across"), ASKED)] if len(two) else []),
        *((say("overlay-ruler", ruler.lines, f"{ruler.length_mm:.0f}"), RULER) for ruler in reading.rulers),
    ]
    picture = with_legend(picture, items, tell)
    write_image(path, picture, dpi=float(MM_PER_INCH * scale))
