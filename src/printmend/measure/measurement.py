"""Scans of one print, put together: the scanner's own axes removed, every mark with its standard deviation."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from printmend.measure.image import write_image
from printmend.measure.plan import ProbePlan, read_plan
from printmend.measure.register import find_pose, turn_onto
from printmend.measure.scan import Reading, read_scan
from printmend.path import Trace
from printmend.units import MM_PER_INCH

QUARTER = 0.35  # |sin| of the turn between two scans that tells the scanner's axes apart
DISAGREEMENT = 6.0  # standard deviations between two scans of one mark: one of them saw dirt
OVERLAY_PX = 3000
ENLARGED = (1, 2, 5, 10, 20, 50)
FOUND, MISSING, ERROR = (60, 170, 60), (40, 40, 230), (230, 120, 30)


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured marks [M, 2] in the bed's frame, NaN where missing; ``sigma_mm`` [M]; ``notes`` for the owner."""

    plan: ProbePlan
    measured_mm: np.ndarray
    sigma_mm: np.ndarray
    notes: tuple[str, ...]

    @property
    def missing(self) -> np.ndarray:
        """The numbers of the marks that were not found."""
        return np.flatnonzero(np.isnan(self.measured_mm).any(axis=1))

    @property
    def trace(self) -> Trace:
        return self.plan.trace(self.measured_mm, self.sigma_mm)


def measure_scans(
    paths: Sequence[str | Path], plan: ProbePlan | str | Path, *, dpi: float | None = None, overlay: Path | None = None
) -> Measurement:
    """Measure one print from one or more scans; draw what was found over the first into ``overlay``.

    ``plan`` is what `write_probe` wrote beside the G-code, or its path. The result's ``trace`` is what to learn from.
    """
    if not isinstance(plan, ProbePlan):
        plan = read_plan(plan)
    # many small matrices: threads of a linear-algebra library would only wait for each other
    with threadpool_limits(1, "blas"):
        return _measured(paths, plan, dpi, overlay)


def _measured(paths: Sequence[str | Path], plan: ProbePlan, dpi: float | None, overlay: Path | None) -> Measurement:
    readings: list[Reading] = []
    notes: list[str] = []
    for path in paths:
        reading = read_scan(path, plan, dpi=dpi)
        if overlay is not None and not readings:
            draw_overlay(overlay, reading, plan)
        # the pixels of one scan at a time
        readings.append(_without_image(reading))
        notes.append(_described(reading))
    places = [reading.image_mm for reading in readings]
    if len(readings) > 1:
        stretch, note = scanner_axes(places)
        places = [place @ np.linalg.inv(stretch).T for place in places]
        notes.append(note)
    first = find_pose(places[0], plan, mirrored=readings[0].marks.match.mirrored).apply(places[0])
    on_bed = [
        first,
        *(_aligned(place, first, reading) for place, reading in zip(places[1:], readings[1:], strict=True)),
    ]
    measured, sigma = _merged(on_bed, [reading.sigma_mm for reading in readings])
    kept = "the x axis keeps its direction" if plan.kinematics == "cartesian" else "the motors share the turn"
    notes.append(f"position and turn are those that fit the commanded marks best ({kept})")
    return Measurement(plan, measured, sigma, tuple(notes))


def scanner_axes(places_mm: Sequence[np.ndarray]) -> tuple[np.ndarray, str]:
    """Return the scanner's own linear map [2, 2] relative to a scanner with equal, square axes, and a note.

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
        return np.eye(2), "the scans are not turned by a quarter: the scanner's own axes stay unknown"
    (even, skew), *_ = np.linalg.lstsq(np.vstack(rows), np.array(wanted), rcond=None)
    stretch = np.eye(2) + np.array([[even, skew], [skew, -even]])
    return (
        stretch,
        f"the scanner's axes differ by {200 * even:+.2f} % and lean by {np.degrees(2 * skew):+.3f}°: removed",
    )


def _aligned(place: np.ndarray, first: np.ndarray, reading: Reading) -> np.ndarray:
    """Turn and shift the marks of a further scan [M, 2] onto those of the first: their common marks fix that best."""
    upright = place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
    both = np.isfinite(upright).all(axis=1) & np.isfinite(first).all(axis=1)
    turned = upright @ turn_onto(upright[both], first[both])
    return turned + np.median((first - turned)[both], axis=0)


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
    empty = np.empty((0, 0, 3), np.uint8)
    return Reading(reading.path, empty, reading.dots, reading.dots_mm, reading.marks, reading.sigma_mm, reading.scale)


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
    words = f"{int(found.sum())} of {len(found)} marks; errors enlarged {enlarged} times"
    cv2.putText(picture, words, (12, 34), cv2.FONT_HERSHEY_SIMPLEX, 1.0, ERROR, 2, cv2.LINE_AA)
    write_image(path, picture, dpi=float(MM_PER_INCH * scale))


def _affine(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the affine map [3, 2] from ``source`` [N, 2] to ``target``."""
    fit, *_ = np.linalg.lstsq(np.hstack([source, np.ones((len(source), 1))]), target, rcond=None)
    return fit
