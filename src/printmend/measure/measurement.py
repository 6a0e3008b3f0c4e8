"""Scans of one print, put together: the scanner's own axes removed, every mark with its standard deviation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import ScanError
from printmend.measure.distance import asked, choose_span, scaled_by
from printmend.measure.image import with_legend, write_image
from printmend.measure.plan import ProbePlan, read_plan
from printmend.measure.register import find_pose, turn_onto
from printmend.measure.scan import Reading, check_whole, read_scan
from printmend.path import Instrument, Trace
from printmend.units import MM_PER_INCH

SETTLED_AXES = 1e-4  # what two turns of the plate leave open of the scanner's axes
JOINED = 0.85  # of all marks: where a scan shows fewer, each shows a part of the print
QUARTER = 0.35  # |sin| of the turn between two scans that tells the scanner's axes apart
DISAGREEMENT = 6.0  # standard deviations between two scans of one mark: one of them saw dirt
LEAST_SHARED, LEAST_APART = (
    25,
    0.25,
)  # marks on two scans that join them, and how far they spread (share of the pattern)
ROUNDS = 12  # of turning every scan onto the mean of all
OVERLAY_PX = 3000
ENLARGED = (1, 2, 5, 10, 20, 50)
FOUND, MISSING, ERROR = (60, 170, 60), (40, 40, 230), (230, 120, 30)


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured marks [M, 2] in the bed's frame, NaN where missing; ``sigma_mm`` [M]; ``notes`` for the owner; how far
    the ``instrument`` is to be trusted, x and y those of the bed."""

    plan: ProbePlan
    measured_mm: np.ndarray
    sigma_mm: np.ndarray
    notes: tuple[str, ...]
    instrument: Instrument

    @property
    def missing(self) -> np.ndarray:
        """The numbers of the marks that were not found."""
        return np.flatnonzero(np.isnan(self.measured_mm).any(axis=1) & ~(self.plan.pen & self.plan.big))

    @property
    def trace(self) -> Trace:
        return replace(self.plan.trace(self.measured_mm, self.sigma_mm), instrument=self.instrument)


def measure_scans(
    paths: Sequence[str | Path],
    plan: ProbePlan | str | Path,
    *,
    dpi: float | None = None,
    overlay: Path | None = None,
    distance_mm: float | None = None,
    look: Callable[[Reading], None] | None = None,
) -> Measurement:
    """Measure one print from one or more scans; draw what was found over the first into ``overlay``.

    ``plan`` is what `write_probe` wrote beside the G-code, or its path. The result's ``trace`` is what to learn from.
    ``distance_mm`` is what callipers say of the two dots that a measurement without it names, outer edge to outer edge:
    it settles the scale. ``look`` is shown what was found in the first scan, its image included. Raises `ScanError`
    as `read_scan` does, `TraceError` for a distance that cannot be theirs.
    """
    if not isinstance(plan, ProbePlan):
        plan = read_plan(plan)
    # many small matrices: threads of a linear-algebra library would only wait for each other
    with threadpool_limits(1, "blas"):
        return _measured(paths, plan, dpi, overlay, distance_mm, look)


def _measured(
    paths: Sequence[str | Path], plan: ProbePlan, dpi: float | None, overlay: Path | None, distance_mm: float | None,
    look: Callable[[Reading], None] | None,
) -> Measurement:  # fmt: skip
    readings: list[Reading] = []
    notes: list[str] = []
    for path in paths:
        reading = read_scan(path, plan, dpi=dpi, whole=len(paths) == 1)
        if overlay is not None and not readings:
            draw_overlay(overlay, reading, plan)
        if look is not None and not readings:
            look(reading)
        # the pixels of one scan at a time
        readings.append(_without_image(reading))
        notes.append(_described(reading))
    places, settled = [reading.image_mm for reading in readings], False
    if len(readings) > 1:
        stretch, note, settled = scanner_axes(places)
        places = [place @ np.linalg.inv(stretch).T for place in places]
        notes.append(note)
    together = np.any([reading.marks.found for reading in readings], axis=0)
    check_whole(readings[0].path, together, plan)
    pose = find_pose(places[0], plan, mirrored=readings[0].marks.match.mirrored)
    first, instrument = pose.apply(places[0]), instrument_on_bed(readings[0].instrument, pose.matrix, settled=settled)
    if min(reading.marks.found.sum() for reading in readings) < JOINED * together.sum():
        on_bed, note = _joined(places, readings, plan)
        notes.append(note)
    else:
        others = zip(places[1:], readings[1:], strict=True)
        on_bed = [first, *(_aligned(place, first, reading) for place, reading in others)]
    measured, sigma = _merged(on_bed, [reading.sigma_mm for reading in readings])
    kept = "the x axis keeps its direction" if plan.kinematics == "cartesian" else "the motors share the turn"
    notes.append(f"position and turn are those that fit the commanded marks best ({kept})")
    span = choose_span(plan, measured)
    if span is not None:
        widths_mm = _mean(np.stack([_widths(reading) for reading in readings]))
        dots_mm = widths_mm[list(span)] if distance_mm is not None else np.zeros(2)
        if distance_mm is not None:
            measured, instrument, note = scaled_by(distance_mm, span, dots_mm, measured, instrument)
        else:
            note = asked(plan, span, measured, float(plan.big_dot_mm))
        notes.append(note)
    if plan.pen:  # a circle says where the pen went round, not where it came to rest
        measured[plan.big], sigma[plan.big] = np.nan, np.nan
    return Measurement(plan, measured, sigma, tuple(notes), instrument)


def instrument_on_bed(instrument: Instrument, matrix: np.ndarray, *, settled: bool) -> Instrument:
    """Return how far an instrument is to be trusted along the bed's axes; ``settled``: two turns show its own."""
    if settled:
        return replace(instrument, axes_sd=SETTLED_AXES, lean_sd=SETTLED_AXES)
    double = 2 * np.arctan2(matrix[0, 1], matrix[0, 0])
    c, s = np.cos(double), np.sin(double)
    axes, lean = instrument.axes_sd, instrument.lean_sd
    return replace(instrument, axes_sd=float(np.hypot(c * axes, s * lean)), lean_sd=float(np.hypot(s * axes, c * lean)))


def _widths(reading: Reading) -> np.ndarray:
    """Return the diameters of the marks' dots as the image shows them [M] mm, NaN where missing."""
    widths, found = np.full(len(reading.marks.found), np.nan), reading.marks.found
    widths[found] = reading.dots.diameter_px[reading.marks.match.dot[found]] * reading.mm_per_px
    return widths


def scanner_axes(places_mm: Sequence[np.ndarray]) -> tuple[np.ndarray, str, bool]:
    """Return the scanner's own linear map [2, 2] relative to a scanner with equal, square axes, a note, and whether the
    scans could tell.

    Two scans of one plate are linked by A = S·R·S⁻¹ with a rotation R. For S = 1 + E, E symmetric and without
    trace, A·Rᵀ − 1 ≈ E − R·E·Rᵀ, which gives E unless R is a half turn.
    """
    rows, wanted, sines = [], [], []
    for other in places_mm[1:]:
        both = np.isfinite(places_mm[0]).all(axis=1) & np.isfinite(other).all(axis=1)
        first, second = places_mm[0][both], other[both]
        link, *_ = np.linalg.lstsq(first - first.mean(axis=0), second - second.mean(axis=0), rcond=None)
        link = link.T
        angle = np.arctan2(link[1, 0] - link[0, 1], link[0, 0] + link[1, 1])
        c, s = np.cos(angle), np.sin(angle)
        rest = link @ np.array([[c, s], [-s, c]])
        wanted += [(rest[0, 0] - rest[1, 1]) / 2, (rest[0, 1] + rest[1, 0]) / 2]
        double = np.array([[np.cos(2 * angle), -np.sin(2 * angle)], [np.sin(2 * angle), np.cos(2 * angle)]])
        rows.append(np.eye(2) - double)
        sines.append(abs(s))
    if max(sines) < QUARTER:
        return np.eye(2), "the scans are not turned by a quarter: the scanner's own axes stay unknown", False
    (even, skew), *_ = np.linalg.lstsq(np.vstack(rows), np.array(wanted), rcond=None)
    stretch = np.eye(2) + np.array([[even, skew], [skew, -even]])
    return (
        stretch,
        f"the scanner's axes differ by {200 * even:+.2f} % and lean by {np.degrees(2 * skew):+.3f}°: removed",
        True,
    )


def _aligned(place: np.ndarray, first: np.ndarray, reading: Reading) -> np.ndarray:
    """Turn and shift the marks of a further scan [M, 2] onto those of the first: their common marks fix that best."""
    upright = place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
    both = np.isfinite(upright).all(axis=1) & np.isfinite(first).all(axis=1)
    turned = upright @ turn_onto(upright[both], first[both])
    return turned + np.median((first - turned)[both], axis=0)


def _joined(places: Sequence[np.ndarray], readings: Sequence[Reading], plan: ProbePlan) -> tuple[list[np.ndarray], str]:
    """Return scans that show parts of one print, [K × [M, 2]] on the bed, and how well their shared marks agree.

    Every scan is turned and shifted onto the mean of all, again and again: least squares over all of them at once.
    Raises `ScanError` for one that shares too few marks with the others.
    """
    upright = [
        place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
        for place, reading in zip(places, readings, strict=True)
    ]
    order = [int(np.argmax([np.isfinite(one[:, 0]).sum() for one in upright]))]
    laid: dict[int, np.ndarray] = {order[0]: upright[order[0]]}
    while len(laid) < len(upright):
        mean = _mean(np.stack(list(laid.values())))
        left = [k for k in range(len(upright)) if k not in laid]
        best = max(left, key=lambda k: _shared(upright[k], mean).sum())
        _check_shared(_shared(upright[best], mean), readings[best], plan)
        laid[best] = _onto(upright[best], mean)
    for _ in range(ROUNDS):
        mean = _mean(np.stack(list(laid.values())))
        laid = {k: _onto(one, mean) for k, one in laid.items()}
    stack = np.stack([laid[k] for k in range(len(upright))])
    mean = _mean(stack)
    pose = find_pose(mean * np.array([1.0, -1.0]), plan, mirrored=False)
    both = np.isfinite(stack[..., 0]).sum(axis=0) > 1
    off = (stack - mean)[:, both]
    apart = float(np.sqrt(np.nanmean(np.sum(off**2, axis=2))))
    note = f"{len(stack)} scans joined by {int(both.sum())} marks that they share: these agree to {apart:.3f} mm"
    return [pose.apply(one * np.array([1.0, -1.0])) for one in stack], note


def _mean(stack: np.ndarray) -> np.ndarray:
    """Return the mean over the first axis of what is there, NaN where nothing is."""
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
    spread = np.ptp(plan.marks_mm[both], axis=0).max() if both.any() else 0.0
    if both.sum() < LEAST_SHARED or spread < LEAST_APART * np.ptp(plan.marks_mm, axis=0).max():
        raise ScanError(
            reading.path, wanted=f"at least {LEAST_SHARED} marks that another scan shows, too",
            came=f"{int(both.sum())}", todo="let neighbouring scans overlap by a third",
        )  # fmt: skip


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
    apart = np.nan_to_num(off).max(axis=0) > DISAGREEMENT * usual
    mean[apart], merged[apart] = np.nan, np.nan
    return mean, merged


def _described(reading: Reading) -> str:
    found, total = int(reading.marks.found.sum()), len(reading.marks.found)
    match, matrix = reading.marks.match, reading.marks.pose.matrix
    side = "seen from below, " if match.mirrored else ""
    upright = np.diag([-1.0 if match.mirrored else 1.0, -1.0]) @ matrix
    turned = np.degrees(np.arctan2(upright[0, 1], upright[0, 0]))
    return f"{reading.path}: {found} of {total} marks, {side}turned by {-turned:.1f}°, {reading.scale}"


def _without_image(reading: Reading) -> Reading:
    return replace(reading, image=np.empty((0, 0, 3), np.uint8))


def draw_overlay(path: Path, reading: Reading, plan: ProbePlan) -> None:
    """Draw found marks as rings, missing ones as crosses, and the error of each mark as a line, enlarged to be seen."""
    factor = min(1.0, OVERLAY_PX / max(reading.image.shape[:2]))
    picture = cv2.resize(reading.image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    pose, found = reading.marks.pose, reading.marks.found
    to_px = _affine(reading.dots_mm, reading.dots.centre_px)

    def pixel(bed_mm: np.ndarray) -> np.ndarray:
        image_mm = (bed_mm - pose.shift_mm) @ np.linalg.inv(pose.matrix)
        px = np.hstack([image_mm, np.ones((len(image_mm), 1))]) @ to_px
        return np.rint(((px + 0.5) * factor - 0.5) * 16).astype(int)

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
    lost = int((~found).sum())
    shown = "true to size" if enlarged == 1 else f"enlarged {enlarged} times"
    items = [
        (f"found: {int(found.sum())} of {len(found)} dots", FOUND),
        (f"how far each lies off, {shown}", ERROR),
        *([(f"not found: {lost}", MISSING)] if lost else []),
    ]
    picture = with_legend(picture, items)
    write_image(path, picture, dpi=float(MM_PER_INCH * scale))


def _affine(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the affine map [3, 2] from ``source`` [N, 2] to ``target``."""
    fit, *_ = np.linalg.lstsq(np.hstack([source, np.ones((len(source), 1))]), target, rcond=None)
    return fit
