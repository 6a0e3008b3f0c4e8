"""Render synthetic scans of a printed probe, as a flatbed scanner would see it, for tests and demonstrations.

`render_scan` draws every dot with its own wobbly outline, and adds strings and tails of plastic, dust, gloss, uneven
light, texture, blur, noise and JPEG artefacts. The scanner stretches the picture, and the plate lies at any angle.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import InputError
from printmend.measure.plan import ProbePlan
from printmend.messages import say
from printmend.path import Trace, distorted
from printmend.units import A4_MM, MM_PER_INCH

MARGIN_MM = 5.0  # margin of glass around the plate
SAME_MM = 0.002  # a trace further from the plan is another print's
LINE_MM, LINE_STEP_MM = 0.6, 0.1  # width of a line at speed, and length of its drawn pieces
TIMES_FINER = 3  # beads are drawn at this multiple of the image's resolution, because widths are whole pixels
BENEATH, BENEATH_BLUR_MM = 0.35, 0.25  # brightness and blur of a first layer that lies far from the glass
Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Degradations:
    """Defects of print and scanner. Lengths are standard deviations unless a comment says otherwise.

    Colours are blue, green, red from 0 to 255.
    """

    filament: Colour = (40, 40, 40)
    background: Colour = (205, 210, 212)
    diameter: float = 0.06  # of a dot, as a share of its diameter
    outline_mm: float = 0.012  # each of the harmonics 2–6 of a dot's outline
    shift_mm: float = 0.004  # the dot against the nozzle that made it
    missing: float = 0.003  # share of the dots that came off
    strings: float = 0.01  # share of the dots with a string to the next one
    tails: float = 0.15  # share of the dots with a short tail of ooze
    gloss: float = 0.25  # strength of the highlight on a dot, 0–1
    dust_per_dm2: float = 15.0
    hairs_per_dm2: float = 0.3
    blur_mm: float = 0.03
    noise: float = 2.0  # grey levels
    texture: float = 2.0  # grey levels
    uneven_light: float = 0.08  # share, peak to peak
    stretch: float = 0.001  # of each of the scanner's axes, share
    wave_mm: float = 0.004  # amplitude of the carriage's uneven run
    lens_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # what the sensor line does, as `distorted` has it
    angle_deg: float = 1.5  # of the plate against the scanner
    jpeg_quality: int | None = 92


CLEAN = Degradations(
    diameter=0.0, outline_mm=0.0, shift_mm=0.0, missing=0.0, strings=0.0, tails=0.0, gloss=0.0, dust_per_dm2=0.0,
    hairs_per_dm2=0.0, noise=0.0, texture=0.0, uneven_light=0.0, stretch=0.0, wave_mm=0.0, angle_deg=0.0,
    jpeg_quality=None,
)  # fmt: skip
DEFAULT = Degradations()
HEAVY = Degradations(
    filament=(60, 75, 150), background=(120, 125, 128), diameter=0.12, outline_mm=0.025, shift_mm=0.012,
    missing=0.02, strings=0.06, tails=0.5, gloss=0.6, dust_per_dm2=80.0, hairs_per_dm2=3.0, blur_mm=0.07, noise=6.0,
    texture=6.0, uneven_light=0.3, stretch=0.002, wave_mm=0.012, angle_deg=5.0, jpeg_quality=75,
)  # fmt: skip


DEGRADATIONS = {"clean": CLEAN, "default": DEFAULT, "heavy": HEAVY}


@dataclass(frozen=True, eq=False)
class Scan:
    """A rendered image [H, W, 3] and the truth: ``marks_px`` [M, 2] and which dots are there (``present`` [M])."""

    image: np.ndarray
    dpi: float
    marks_px: np.ndarray
    present: np.ndarray


def render_scan(
    printed_mm: np.ndarray,
    plan: ProbePlan,
    *,
    dpi: float = 600.0,
    degradations: Degradations = DEFAULT,
    rng: np.random.Generator,
    quarter_turns: int = 0,
    mirrored: bool = False,
    stretch: tuple[float, float] | None = None,
    size_mm: tuple[float, float] | None = None,
    line_mm: np.ndarray | None = None,
) -> Scan:
    """Draw the marks of ``plan`` where they were printed, [M, 2] mm.

    ``quarter_turns`` turns the plate on the glass, ``mirrored`` shows it from below. ``stretch`` fixes the scanner's
    own axes, for a second scan on the same scanner. The image measures ``size_mm``; by default A4, smaller for a small
    print and larger for a large one. ``line_mm`` [N, 2] is the path of the plan's lines at speed.
    """
    d = degradations
    px_per_mm = dpi / MM_PER_INCH
    angle = np.deg2rad(90.0 * quarter_turns + rng.normal(0.0, d.angle_deg))
    if stretch is None:
        stretch = tuple(np.clip(rng.normal(0.0, d.stretch, 2), -2 * d.stretch, 2 * d.stretch))
    line_mm = np.empty((0, 2)) if line_mm is None else line_mm
    laid, size_mm = _placed(np.vstack([printed_mm, line_mm]), angle, mirrored, np.array(stretch), size_mm)
    marks, line = np.split(laid, [len(printed_mm)])
    truth = marks
    marks = marks + rng.normal(0.0, d.shift_mm, marks.shape)
    wavelength, phase = rng.uniform(20, 60), rng.uniform(0, 2 * np.pi)
    marks[:, 1] += d.wave_mm * np.sin(2 * np.pi * marks[:, 1] / wavelength + phase)
    marks += distorted(marks - np.array(size_mm) / 2, 0) @ np.array(d.lens_mm)
    width, height = (round(side * px_per_mm) for side in size_mm)
    ink = np.zeros((height, width), np.uint8)
    present = rng.random(len(plan)) >= d.missing
    diameters = plan.diameter_mm * (1 + rng.normal(0.0, d.diameter, len(plan)).clip(-0.3, 0.3))
    gloss = []
    for index in np.flatnonzero(present):
        patch = _Patch.around(marks[index] * px_per_mm, (0.7 * diameters[index] + 0.3) * px_per_mm, ink.shape)
        _draw_dot(ink, patch, diameters[index] / 2 * px_per_mm, d.outline_mm * px_per_mm, rng)
        gloss.append((patch, 0.3 * diameters[index] * px_per_mm))
    if len(line):
        _draw_line(ink, line * px_per_mm, LINE_MM * px_per_mm, d.outline_mm * px_per_mm, px_per_mm, rng)
    _draw_strings(ink, marks, present, diameters, px_per_mm, d, rng)
    if d.blur_mm:
        cv2.GaussianBlur(ink, (0, 0), d.blur_mm * px_per_mm, dst=ink)
    image = _developed(ink, gloss, d, px_per_mm, rng)
    return Scan(image, dpi, truth * px_per_mm, present)


def scan_trace(
    trace: Trace,
    plan: ProbePlan,
    *,
    dpi: float,
    degradations: Degradations,
    rng: np.random.Generator,
    quarter_turns: int = 0,
) -> Scan:
    """Draw the scan of a probe that was printed on the twin; ``trace`` is what the twin printed, without noise.

    Equal generators draw the same dots and the same scanner, so that the plate can be turned between two scans. Raises
    `InputError` if the trace belongs to another file.
    """
    same = trace.commanded_mm.shape == plan.waypoints_mm.shape
    if not same or np.abs(trace.commanded_mm - plan.waypoints_mm).max() > SAME_MM:
        raise InputError(
            say("subject-printed-file"),
            wanted=say("probe-plan-way-points", len(plan.waypoints_mm)),
            came=say("file-other-way-points", len(trace)),
            todo=say("terminal-print-g-code-was-written-together"),
        )
    line = trace.measured_mm[plan.moving :] if plan.moving else None
    return render_scan(
        trace.measured_mm[plan.rows],
        plan,
        line_mm=line,
        dpi=dpi,
        degradations=degradations,
        rng=rng,
        quarter_turns=quarter_turns,
    )


def _placed(
    printed_mm: np.ndarray, angle: float, mirrored: bool, stretch: np.ndarray, size_mm: tuple[float, float] | None
) -> tuple[np.ndarray, tuple[float, float]]:
    """Return the marks on the glass [M, 2] mm and the size of the image [mm]."""
    c, s = np.cos(angle), np.sin(angle)
    # the y axis of an image points down, so an upright picture of the bed has y flipped
    flip = np.array([-1.0 if mirrored else 1.0, -1.0])
    turned = (printed_mm * flip) @ np.array([[c, s], [-s, c]]) * (1.0 + stretch)
    low, high = turned.min(axis=0), turned.max(axis=0)
    span = high - low + 2 * MARGIN_MM
    if size_mm is not None:
        return turned - low + (np.array(size_mm) - (high - low)) / 2, size_mm
    size = (max(A4_MM[0], span[0]), max(A4_MM[1], span[1])) if span.max() > A4_MM[0] / 2 else (span[0], span[1])
    return turned - low + (np.array(size) - (high - low)) / 2, (float(size[0]), float(size[1]))


@dataclass(frozen=True, eq=False)
class _Patch:
    """A window of an image and the pixels' offsets from a centre."""

    rows: slice
    columns: slice
    dx: np.ndarray
    dy: np.ndarray

    @classmethod
    def around(cls, centre_px: np.ndarray, reach_px: float, shape: tuple[int, ...]) -> "_Patch":
        x0, y0 = (max(0, int(value - reach_px)) for value in centre_px)
        x1, y1 = int(centre_px[0] + reach_px) + 2, int(centre_px[1] + reach_px) + 2
        x1, y1 = max(x0, min(x1, shape[1])), max(y0, min(y1, shape[0]))
        dx, dy = np.meshgrid(np.arange(x0, x1) - centre_px[0], np.arange(y0, y1) - centre_px[1])
        return cls(slice(y0, y1), slice(x0, x1), dx, dy)


def _draw_dot(ink: np.ndarray, patch: _Patch, radius_px: float, outline_px: float, rng: np.random.Generator) -> None:
    """Draw a dot with a wobbly outline."""
    angle = np.arctan2(patch.dy, patch.dx)
    radius = np.full(angle.shape, radius_px)
    for k in range(2, 7):
        amplitude, phase = rng.normal(0.0, outline_px), rng.uniform(0, 2 * np.pi)
        radius += amplitude * np.cos(k * angle + phase)
    _cover(ink, patch, radius - np.hypot(patch.dx, patch.dy))


# Six parameters, because a line has a place, a width and a wobble.
def _draw_line(
    ink: np.ndarray, points_px: np.ndarray, width_px: float, outline_px: float, px_per_mm: float,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Draw a line through points [N, 2] whose two edges wobble, each by itself, over half a millimetre."""
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_px, axis=0).T))])
    places = np.arange(0.0, gone[-1], LINE_STEP_MM * px_per_mm)
    path = np.stack([np.interp(places, gone, points_px[:, axis]) for axis in range(2)], axis=1)
    window = np.hanning(2 * round(0.5 / LINE_STEP_MM) + 1)
    edges = rng.standard_normal((2, len(path) + len(window) - 1))
    left, right = outline_px * np.array([np.convolve(edge, window / np.linalg.norm(window), "valid") for edge in edges])
    way = np.gradient(path, axis=0)
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    path = path + ((left - right) / 2)[:, None] * normal
    for at in range(len(path) - 1):
        _draw_stroke(ink, path[at], path[at + 1], width_px + left[at] + right[at])


def _draw_stroke(ink: np.ndarray, a_px: np.ndarray, b_px: np.ndarray, width_px: float) -> None:
    """Draw a straight stroke with round ends."""
    along = b_px - a_px
    length = float(np.hypot(*along)) + 1e-9
    patch = _Patch.around((a_px + b_px) / 2, length / 2 + width_px + 1, ink.shape)
    x, y = patch.dx + along[0] / 2, patch.dy + along[1] / 2
    share = ((x * along[0] + y * along[1]) / length**2).clip(0, 1)
    _cover(ink, patch, width_px / 2 - np.hypot(x - share * along[0], y - share * along[1]))


def _cover(ink: np.ndarray, patch: _Patch, inside_px: np.ndarray) -> None:
    """Add the pixels whose signed distance to the outline is ``inside_px``, with smooth edges."""
    window = ink[patch.rows, patch.columns]
    np.maximum(window, (np.clip(inside_px + 0.5, 0, 1) * 255 + 0.5).astype(np.uint8), out=window)


def _draw_strings(
    ink: np.ndarray,
    marks_mm: np.ndarray,
    present: np.ndarray,
    diameters: np.ndarray,
    px_per_mm: float,
    d: Degradations,
    rng: np.random.Generator,
) -> None:
    """Draw the strings between dots and the tails of ooze."""
    for index in np.flatnonzero(present[:-1]):
        step = marks_mm[index + 1] - marks_mm[index]
        if rng.random() < d.strings:
            width = rng.uniform(0.1, 0.35) * px_per_mm
            _draw_stroke(ink, marks_mm[index] * px_per_mm, marks_mm[index + 1] * px_per_mm, width)
        elif rng.random() < d.tails:
            length = diameters[index] / 2 + rng.uniform(0.1, 0.6)
            end = marks_mm[index] + step / (np.hypot(*step) + 1e-9) * length
            _draw_stroke(ink, marks_mm[index] * px_per_mm, end * px_per_mm, rng.uniform(0.05, 0.2) * px_per_mm)


def _developed(
    ink: np.ndarray,
    gloss: list[tuple[_Patch, float]],
    d: Degradations,
    px_per_mm: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Turn the ink into an image with colours, light and dirt."""
    height, width = ink.shape
    coarse = (height // 4 + 2, width // 4 + 2)
    texture = rng.standard_normal(coarse, np.float32) * np.float32(d.texture * 1.6)
    shade = cv2.resize(texture, (width, height), interpolation=cv2.INTER_LINEAR)
    if d.noise:
        shade += rng.standard_normal(ink.shape, np.float32) * np.float32(d.noise)
    for patch, spread in gloss:
        if d.gloss:
            at = rng.normal(0.0, 0.5 * spread, 2)
            spot = np.exp(-((patch.dx - at[0]) ** 2 + (patch.dy - at[1]) ** 2) / (0.18 * spread**2 + 1))
            strength = 120 * d.gloss * rng.random()
            shade[patch.rows, patch.columns] += strength * spot * (ink[patch.rows, patch.columns] / 255.0)
    tilt = rng.normal(size=3)
    x, y = np.linspace(-1, 1, width, dtype=np.float32), np.linspace(-1, 1, height, dtype=np.float32)
    light = tilt[0] * x[None] + tilt[1] * y[:, None] + tilt[2] * (x[None] ** 2 + y[:, None] ** 2 - 1)
    light = (1 + d.uneven_light / 2 * light / (np.abs(light).max() + 1e-9)).astype(np.float32)
    image = np.empty((height, width, 3), np.uint8)
    share = ink.astype(np.float32) / np.float32(255)
    for channel in range(3):
        plane = share * np.float32(d.filament[channel] - d.background[channel])
        plane += np.float32(d.background[channel])
        plane *= light
        plane += shade
        image[:, :, channel] = np.clip(plane, 0, 255, out=plane)
    _sprinkle(image, d, px_per_mm, rng)
    if d.jpeg_quality is not None:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, d.jpeg_quality])
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))
    return image


def _sprinkle(image: np.ndarray, d: Degradations, px_per_mm: float, rng: np.random.Generator) -> None:
    """Put dust and hairs on the glass."""
    height, width = image.shape[:2]
    area_dm2 = height * width / (100 * px_per_mm) ** 2
    fine = 16.0  # OpenCV draws in sixteenths of a pixel with shift=4
    for _ in range(rng.poisson(d.dust_per_dm2 * area_dm2)):
        at = (int(rng.uniform(0, width) * fine), int(rng.uniform(0, height) * fine))
        axes = tuple(int(side * px_per_mm * fine) for side in rng.uniform(0.02, 0.15, 2))
        grey = int(rng.choice([20, 240]) + rng.integers(-15, 15))
        cv2.ellipse(image, at, axes, rng.uniform(0, 180), 0, 360, (grey, grey, grey), -1, cv2.LINE_AA, 4)
    for _ in range(rng.poisson(d.hairs_per_dm2 * area_dm2)):
        turn = np.cumsum(rng.normal(0, 0.15, 20)) + rng.uniform(0, 2 * np.pi)
        steps = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(0.1, 0.5) * px_per_mm
        line = np.cumsum(steps, axis=0) + rng.uniform(0, 1, 2) * [width, height]
        thick = max(1, round(0.05 * px_per_mm))
        cv2.polylines(image, [(line * fine).astype(np.int32)], False, (60, 60, 60), thick, cv2.LINE_AA, 4)


def render_layer(
    strokes_mm: Sequence[np.ndarray],
    *,
    bead_mm: float | Sequence[np.ndarray],
    dpi: float = 600.0,
    degradations: Degradations = DEFAULT,
    rng: np.random.Generator,
    quarter_turns: int = 0,
    beneath: Sequence[tuple[np.ndarray, np.ndarray]] | None = None,
) -> np.ndarray:
    """Draw a printed first layer as a flatbed sees it from below, [H, W, 3]: its strokes as beads.

    The strokes are [K × [N, 2]] mm on the bed. ``bead_mm`` is their common width, or each one's width [N] up to each
    point. ``quarter_turns`` turns the part on the glass. If ``beneath`` holds a first layer's beads, the part lies on
    its top.
    """
    d = degradations
    px_per_mm = dpi / MM_PER_INCH
    angle = np.deg2rad(90.0 * quarter_turns + rng.normal(0.0, d.angle_deg))
    stretch = np.clip(rng.normal(0.0, d.stretch, 2), -2 * d.stretch, 2 * d.stretch)
    c, s = np.cos(angle), np.sin(angle)
    flip = np.array([-1.0 if beneath is None else 1.0, -1.0])
    widths_mm = [np.full(len(each), bead_mm) for each in strokes_mm] if isinstance(bead_mm, float) else bead_mm
    levels: list[tuple[Iterable[tuple[np.ndarray, np.ndarray]], float, float]] = [
        (zip(strokes_mm, widths_mm, strict=True), 1.0, d.blur_mm)
    ]
    if beneath is not None:
        levels.insert(0, (beneath, BENEATH, BENEATH_BLUR_MM))
    laid = [
        (
            [((stroke * flip) @ np.array([[c, s], [-s, c]]) * (1.0 + stretch), wide) for stroke, wide in beads],
            dark,
            blur,
        )
        for beads, dark, blur in levels
    ]
    every = np.vstack([stroke for beads, *_ in laid for stroke, _ in beads])
    low = every.min(axis=0) - 3 * MARGIN_MM
    width, height = np.ceil((every.max(axis=0) + 3 * MARGIN_MM - low) * px_per_mm).astype(int)
    ink = np.zeros((height, width), np.uint8)
    for beads, dark, blur_mm in laid:
        level = _beads(beads, low, ink.shape, px_per_mm)
        if blur_mm:
            cv2.GaussianBlur(level, (0, 0), blur_mm * px_per_mm, dst=level)
        np.maximum(ink, cv2.convertScaleAbs(level, alpha=dark), out=ink)
    return _developed(ink, [], d, px_per_mm, rng)


def _beads(
    beads: Sequence[tuple[np.ndarray, np.ndarray]], low_mm: np.ndarray, shape: tuple[int, ...], px_per_mm: float
) -> np.ndarray:
    """Return the ink [H, W] of beads with their own widths."""
    scale, fine = TIMES_FINER * px_per_mm, 16.0
    ink = np.zeros([TIMES_FINER * side for side in shape], np.uint8)
    for stroke, wide in beads:
        points = np.rint((stroke - low_mm) * scale * fine).astype(np.int32)
        thick = np.maximum(2 * np.rint(wide * scale / 2).astype(int), 2)  # OpenCV draws odd ones a pixel wider
        cuts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(thick[1:])), [len(points) - 1]])
        for first, last in itertools.pairwise(cuts.tolist()):
            cv2.polylines(ink, [points[first : last + 1]], False, 255, int(thick[last]), cv2.LINE_AA, 4)
    return np.asarray(cv2.resize(ink, shape[::-1], interpolation=cv2.INTER_AREA))
