"""A broken printer prints its own timing pulley, runs on it, prints the next: as it is, and with printmend.

After R. Caballero and E. Feron, physics.md [C22]. The printed contour comes out of the twin: the nozzle's path, a bead
around it, shrinkage, a rough edge. The belt feels its convex hull about the printed bore, and the next generation is
printed with that. Teeth are taken to mesh whatever the pulley's size; nothing but the pulleys changes. The report has a
table, the outlines beside the errors, and the damages that converge.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from printmend.corruption import Corruption, Drive, EccentricBore, Play, PublishedHull, TabulatedHull, published_names
from printmend.demo import contour
from printmend.errors import InputError, PrintmendError, RefusedError
from printmend.files import replacing
from printmend.gcode.read import read_gcode
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism
from printmend.mend import mend_gcode
from printmend.model import SavedModel
from printmend.path import Trace
from printmend.printer import Printer
from printmend.probe import design_probe
from printmend.probe.gcode import CLOSING, PLAIN_START, filament_mm
from printmend.twin import Twin
from printmend.units import TURN_RAD
from printmend_lab.body.generated import PITCH_LINE_OFFSET_MM, PITCH_MM, toothed_outline_mm

# A timing pulley that fits a motor, as G-code: a hub with a set screw, a flange, 20 teeth, a bore.
#
# It is drawn layer by layer: a region of the plane becomes closed beads, the outermost first, until it is full.

TEETH = 20  # as printers' motors have
RADIUS_MM = TEETH * PITCH_MM / TURN_RAD  # where the belt's cords run
TIP_MM = RADIUS_MM - PITCH_LINE_OFFSET_MM  # radius of the teeth's tips
BORE_MM = 5.0  # of a NEMA 17 motor's shaft
HUB_DIAMETER_MM, HUB_MM = 18.0, 7.0  # of the hub: its diameter and height
FLANGE_MM, TOOTHED_MM = 1.0, 7.0  # for a belt of 6 mm
SET_SCREW_MM = 2.5  # to be tapped M3
BEAD_MM, LAYER_MM = 0.4, 0.2  # a bead's width and height
FEED_MM_S, FIRST_FEED_MM_S, TRAVEL_MM_S = 25.0, 15.0, 120.0
RETRACT_MM, RETRACT_MM_S = 2.5, 30.0
_SMOOTH_MM = 0.005  # what a bead may leave out of its line
_TOOTHED_FROM_MM = HUB_MM + FLANGE_MM  # height at which the teeth begin
TOOTHED_LAYER = round((_TOOTHED_FROM_MM + TOOTHED_MM / 2) / LAYER_MM)  # half-way up the teeth
HEAD = """\
; printmend selfrepair: a GT2 pulley of {teeth} teeth, bore {bore:g} mm, set screw M3 (drill {screw:g} mm, tap)
; for {printer}, nozzle 0.4 mm. Change the temperatures below for another material than PLA.
"""


def pulley_gcode(printer: Printer) -> str:
    """Return the file that prints the pulley in the middle of the bed. Relative E, one object, no support."""
    middle = np.array(printer.middle_mm)
    head = HEAD.format(teeth=TEETH, bore=BORE_MM, screw=SET_SCREW_MM, printer=printer.name)
    lines = [head, PLAIN_START, "G21\n", "G90\n", "M83\n", "G92 E0\n"]
    for number in range(round((_TOOTHED_FROM_MM + TOOTHED_MM) / LAYER_MM)):
        z_mm = (number + 1) * LAYER_MM
        feed_mm_s = FIRST_FEED_MM_S if number == 0 else FEED_MM_S
        lines.append(f";LAYER:{number}\nG1 Z{z_mm:g} F600\n")
        for bead in beads_mm(section(z_mm - LAYER_MM / 2)):
            lines += _bead(bead + middle, feed_mm_s)
    top_mm = _TOOTHED_FROM_MM + TOOTHED_MM + 10
    return "".join([*lines, f"G1 Z{top_mm:g} F600\n", CLOSING])


def section(z_mm: float) -> shapely.Polygon:
    """Return the pulley's cross-section at a height, about its axis."""
    if z_mm > _TOOTHED_FROM_MM:
        outline = shapely.Polygon(toothed_outline_mm(TEETH))
    else:
        outline = shapely.Point(0, 0).buffer(HUB_DIAMETER_MM / 2, quad_segs=32)
    solid = outline.difference(shapely.Point(0, 0).buffer(BORE_MM / 2, quad_segs=16))
    off_mm = abs(z_mm - HUB_MM / 2)
    if off_mm < SET_SCREW_MM / 2:  # a round hole from the bore outwards, cut at this height
        half_mm = np.sqrt((SET_SCREW_MM / 2) ** 2 - off_mm**2)
        solid = solid.difference(shapely.box(0, -half_mm, HUB_DIAMETER_MM, half_mm))
    return solid


def beads_mm(region: shapely.Polygon) -> list[np.ndarray]:
    """Return closed lines [N, 2] that fill a region with beads, from its edge inwards."""
    lines = []
    inner = region.buffer(-BEAD_MM / 2)
    while not inner.is_empty:
        for part in getattr(inner, "geoms", [inner]):
            rings = [part.exterior, *part.interiors]
            lines += [shapely.get_coordinates(ring.simplify(_SMOOTH_MM)) for ring in rings]
        inner = inner.buffer(-BEAD_MM)
    return [line for line in lines if len(line) > 2]


def _bead(line_mm: np.ndarray, feed_mm_s: float) -> list[str]:
    """Return the lines that travel to a bead's start and print it."""
    x, y = line_mm[0]
    back = f"F{RETRACT_MM_S * 60:g}"
    lines = [f"G1 E-{RETRACT_MM:g} {back}\n", f"G0 X{x:.3f} Y{y:.3f} F{TRAVEL_MM_S * 60:g}\n",
             f"G1 E{RETRACT_MM:g} {back}\n"]  # fmt: skip
    feed = f" F{feed_mm_s * 60:g}"
    for before, (x, y) in pairwise(line_mm):
        length = float(np.hypot(x - before[0], y - before[1]))
        lines.append(f"G1 X{x:.3f} Y{y:.3f} E{filament_mm(length * BEAD_MM * LAYER_MM):.5f}{feed}\n")
        feed = ""
    return lines


SHRINKAGE = 0.003  # of PLA, linear
ROUGH_MM = 0.02  # RMS of the printed edge about its line
ROUGH_WAVES = 12  # sines that make up the rough edge
MEASURED_MM = 0.05  # noise of a mark of the test print, each coordinate
ANGLES = 720  # at which a hull is known
CONVERGED_MM = 0.1  # RMS: what bead, shrinkage and measurement leave of a pulley is about half of it
LEAST_PLAY_MM = 1e-3  # less is none
OPEN, MENDED = "as it is", "printmend"

# The purposes for which a generation's generator is seeded, the same for both ways, so that they compare in pairs.
_MOUNT, _EDGE, _MARKS = 1, 2, 3


@dataclass(frozen=True, eq=False)
class PrintedPulley:
    """A pulley as printed: ``outline_mm`` [N, 2] about its bore, ``support_mm`` [ANGLES] as its belt feels it."""

    outline_mm: np.ndarray
    support_mm: np.ndarray

    @property
    def rms_mm(self) -> float:
        """How far the belt's moment arm is from a good pulley's, RMS over a turn."""
        return float(np.sqrt(np.mean((self.support_mm - RADIUS_MM) ** 2)))

    @property
    def size_mm(self) -> float:
        """How much larger than a good pulley it is: what of the error is a mere scale."""
        return float(self.support_mm.mean() - RADIUS_MM)


@dataclass(frozen=True, eq=False)
class Series:
    """The pulleys of one way, ``start_mm`` the RMS error of the broken machine's own; ``ended`` says why it stopped."""

    way: str
    start_mm: float
    pulleys: tuple[PrintedPulley, ...]
    ended: str = ""

    @property
    def errors_mm(self) -> tuple[float, ...]:
        return (self.start_mm, *(pulley.rms_mm for pulley in self.pulleys))

    @property
    def verdict(self) -> str:
        """Say whether it converged, in one word or two."""
        errors = self.errors_mm
        if self.ended:
            return f"ends at {len(self.pulleys)}"
        below = [number for number, error in enumerate(errors) if error < CONVERGED_MM]
        if below and max(errors[below[0] :]) < 2 * CONVERGED_MM:
            return f"converges at {below[0]}"
        return "grows" if errors[-1] > errors[0] else "stays off"


def run_series(
    printer: Printer,
    broken: Corruption | SavedModel,
    work: Path,
    *,
    mended: bool,
    generations: int,
    both: bool,
    seed: int,
    tick: Callable[[str], None] = lambda what: None,
) -> Series:
    """Print ``generations`` of pulleys, each on the machine that runs on the one before; files lie in ``work``.

    The pulley replaces that of the first motor, or those of ``both``. A `SavedModel` is a machine that was learned:
    its pulleys are replaced, its play stays. With ``mended`` each generation begins with a test print that is measured
    and learned from (the given model is that of the first).
    """
    source = work / "pulley.gcode"
    if not source.exists():
        with replacing(source) as file:
            file.write(pulley_gcode(printer))
    twin = Twin(broken.mechanism) if isinstance(broken, SavedModel) else Twin.of(broken, printer)
    slack = _slack(broken)
    frame = broken.frame if isinstance(broken, Corruption) else None
    motors = (0, 1) if both else (0,)
    start_mm = _machine_error_mm(twin.homed(), motors)
    pulleys: list[PrintedPulley] = []
    model = broken if isinstance(broken, SavedModel) else None
    ended, way = "", MENDED if mended else OPEN
    for number in range(generations):
        try:
            file_mm = _mended_file(twin, model, source, work, number, seed) if mended else source
            pulleys.append(printed_pulley(file_mm, twin, np.random.default_rng([seed, number, _EDGE])))
            shift = int(np.random.default_rng([seed, number, _MOUNT]).integers(ANGLES))
            hull = TabulatedHull(tuple(np.roll(pulleys[-1].support_mm, shift)))
        except PrintmendError as error:
            ended = str(error)
            break
        finally:
            tick(f"{way}: generation {number + 1}")
        twin = Twin.of(Corruption(_replaced(slack, hull, motors), frame), printer)
        model = None
    return Series(way, start_mm, tuple(pulleys), ended)


def printed_pulley(file: Path, twin: Twin, rng: np.random.Generator) -> PrintedPulley:
    """Return what the machine makes of the pulley's file. Raise `InputError` where it cannot go onto a shaft."""
    way = contour.run(read_gcode(file, printer=twin.printer), twin)
    drawn = np.flatnonzero(way.extruding & (way.layer == TOOTHED_LAYER))
    strokes = np.stack([way.printed_mm[drawn], way.printed_mm[drawn + 1]], axis=1)
    plastic = shapely.MultiLineString(list(strokes)).buffer(BEAD_MM / 2)
    body = max(getattr(plastic, "geoms", [plastic]), key=lambda part: part.area)
    bores = [shapely.Polygon(ring) for ring in body.interiors]
    if not bores:
        raise InputError("the printed pulley", wanted="a bore for the shaft", came="none", todo="mend the file first")
    axis = shapely.get_coordinates(max(bores, key=lambda ring: ring.area).centroid)[0]
    outline = (shapely.get_coordinates(body.exterior) - axis) * (1 - SHRINKAGE)
    angle = np.arctan2(outline[:, 1], outline[:, 0])
    waves = np.arange(1, ROUGH_WAVES + 1)
    a, b = rng.normal(0.0, ROUGH_MM / np.sqrt(ROUGH_WAVES), (2, ROUGH_WAVES))
    rough = np.cos(np.outer(angle, waves)) @ a + np.sin(np.outer(angle, waves)) @ b
    outline = outline * (1 + rough / np.hypot(*outline.T))[:, None]
    support = support_mm(outline) + PITCH_LINE_OFFSET_MM
    if support.min() <= 0.5 * BEAD_MM:
        raise InputError("the printed pulley", wanted="a shaft inside it", came="a bore beside it", todo="mend first")
    return PrintedPulley(outline, support)


def support_mm(outline_mm: np.ndarray) -> np.ndarray:
    """Return h = max p·(cos φ, sin φ) over an outline [N, 2] at `ANGLES` angles from 0."""
    phi = np.arange(ANGLES) * TURN_RAD / ANGLES
    hull = shapely.get_coordinates(shapely.MultiPoint(outline_mm).convex_hull)
    return np.asarray((hull @ np.stack([np.cos(phi), np.sin(phi)])).max(axis=0))


def _mended_file(
    twin: Twin, model: SavedModel | None, source: Path, work: Path, number: int, seed: int
) -> Path:  # fmt: skip
    """Return the file to print: mended for the machine as it is now, or the source where mending would not help."""
    if model is None:
        plan = design_probe(twin.printer)
        marks = twin.follow(plan.waypoints_mm)[:, :2]
        noise = np.random.default_rng([seed, number, _MARKS]).normal(0.0, MEASURED_MM, (len(plan), 2))
        measured = np.full(marks.shape, np.nan)
        measured[plan.rows] = marks[plan.rows] + noise
        model = learn_model(Trace(plan.waypoints_mm, measured, homed=True), twin.printer)
    target = work / f"generation-{number + 1}.mended.gcode"
    try:
        mend_gcode(source, model, target)
    except RefusedError:
        return source
    return target


def _slack(broken: Corruption | SavedModel) -> Sequence[Drive]:
    """Return what stays of each motor's drive when its pulley is replaced."""
    if isinstance(broken, Corruption):
        return broken.drives
    widths = [float(np.mean(motor.upper_mm - motor.lower_mm)) for motor in broken.mechanism.transmissions]
    return [Drive(belt=Play(width) if width > LEAST_PLAY_MM else None) for width in widths]


def _replaced(drives: Sequence[Drive], hull: TabulatedHull, motors: Sequence[int]) -> tuple[Drive, Drive]:
    """Return the drives with a printed pulley on some motors."""
    x, y = (replace(drive, pulley=hull) if motor in motors else drive for motor, drive in enumerate(drives))
    return x, y


def _machine_error_mm(mechanism: Mechanism, motors: Sequence[int]) -> float:
    """Return the RMS over a turn of how far the motors' moment arms, RADIUS·du/dm, are from a good pulley's."""
    errors = []
    for motor in motors:
        table = mechanism.transmissions[motor]
        turn = round(mechanism.printer.axes[motor].mm_per_turn / table.pitch_mm)
        middle_mm = (table.lower_mm + table.upper_mm)[: turn + 1] / 2
        errors.append(RADIUS_MM * (np.diff(middle_mm) / table.pitch_mm - 1))
    return float(np.sqrt(np.mean(np.square(errors))))


HEADER = ("way", "generation", "RMS mm", "size mm", "shape mm")
DAMAGE_HEADER = ("damage", "at first", f"{OPEN}, one pulley", f"{OPEN}, both", f"{MENDED}, one", f"{MENDED}, both")
WAYS = (OPEN, MENDED)


def hull_damage(name: str, *, both: bool = False, play_mm: float = 0.0) -> Corruption:
    """Return the machine whose first motor, or ``both``, has that published pulley, and as much play."""
    drive = Drive(pulley=PublishedHull(name), belt=Play(play_mm) if play_mm else None)
    return Corruption((drive, drive if both else Drive()))


def damages(*, both: bool) -> dict[str, Corruption]:
    """Return the damages that are compared: the published hulls, bores ever farther off, ever more play."""
    found = {name: hull_damage(name, both=both) for name in published_names() if name != "ideal"}
    for off_mm in (0.5, 2.0, 4.0, 6.0):
        drive = Drive(pulley=EccentricBore(off_mm))
        found[f"bore {off_mm:g} mm off"] = Corruption((drive, drive if both else Drive()))
    for play_mm in (0.5, 2.0, 4.0):
        found[f"egg, play {play_mm:g} mm"] = hull_damage("egg", both=both, play_mm=play_mm)
    return found


def run_both(
    printer: Printer, broken: Corruption | SavedModel, work: Path, *, generations: int, both: bool, seed: int,
    tick: Callable[[str], None] = lambda what: None,
) -> list[Series]:  # fmt: skip
    """Run self-repair as it is and with printmend, on equal draws."""
    return [
        run_series(
            printer, broken, work, mended=way == MENDED, generations=generations, both=both, seed=seed, tick=tick
        )
        for way in WAYS
    ]


def rows(series: Sequence[Series]) -> list[tuple[str, ...]]:
    """Return the table's texts, in the order of `HEADER`; size is of the mean radius, shape what is not size."""
    lines: list[tuple[str, ...]] = []
    for one in series:
        lines.append((one.way, "0", f"{one.start_mm:.3f}", "–", "–"))
        for number, pulley in enumerate(one.pulleys, start=1):
            shape = float(pulley.support_mm.std())
            lines.append((one.way, str(number), f"{pulley.rms_mm:.3f}", f"{pulley.size_mm:+.3f}", f"{shape:.3f}"))
    return lines


def closing(series: Sequence[Series]) -> list[str]:
    """Say of each way whether it converged, and why it ended."""
    return [
        f"{one.way}: {one.verdict} (below {CONVERGED_MM:g} mm RMS counts as converged)"
        + (f": {one.ended}" if one.ended else "")
        for one in series
    ]


def damage_rows(
    printer: Printer, work: Path, *, generations: int, seed: int, tick: Callable[[str], None] = lambda what: None
) -> list[tuple[str, ...]]:
    """Return a line for each of `damages`: the first error and what became of it, way by way."""
    lines = []
    for name in damages(both=False):
        of_one, of_both = (
            run_both(printer, damages(both=both)[name], work, generations=generations, both=both, seed=seed, tick=tick)
            for both in (False, True)
        )
        texts = [f"{one.errors_mm[-1]:.3f} {one.verdict}" for one in (of_one[0], of_both[0], of_one[1], of_both[1])]
        lines.append((name, f"{of_one[0].start_mm:.3f}", *texts))
    return lines


def draw(series: Sequence[Series], path: Path, *, title: str) -> Path:
    """Draw the printed outlines of each way, and the error against the generation."""
    from printmend.draw import new_figure, save
    from printmend.draw.figure import ERROR_COLOURS, INK, PALETTE, fit_view, plain, quiet

    figure, axes = new_figure(len(series) + 1, width_in=4.2, height_in=4.4)
    circle = np.linspace(0, TURN_RAD, 361)
    reach = max([np.abs(pulley.outline_mm).max() for one in series for pulley in one.pulleys] or [TIP_MM])
    for one, place in zip(series, axes, strict=False):
        for number, pulley in reversed(list(enumerate(one.pulleys))):
            shade = ERROR_COLOURS(1 - number / max(len(one.pulleys) - 1, 1))
            place.plot(*pulley.outline_mm.T, color=shade, linewidth=1.0, label=f"{number + 1}")
        place.plot(TIP_MM * np.cos(circle), TIP_MM * np.sin(circle), color=INK, linewidth=0.8, linestyle=":")
        plain(fit_view(place, np.full(2, -reach), np.full(2, reach)))
        place.set_title(f"printed pulleys, {one.way}", color=INK, fontsize=10)
        if one.pulleys:
            place.legend(title="generation", fontsize=7, title_fontsize=7, loc="center", frameon=False)
    for one, colour in zip(series, PALETTE[1::-1], strict=False):
        errors = one.errors_mm
        axes[-1].semilogy(range(len(errors)), errors, "o-", color=colour, label=one.way)
    axes[-1].axhline(CONVERGED_MM, color=INK, linewidth=0.8, linestyle=":")
    axes[-1].set_xlabel("generation (0: the broken machine)", color=INK, fontsize=9)
    axes[-1].set_title("moment arm off a good pulley's, RMS [mm]", color=INK, fontsize=10)
    axes[-1].legend(fontsize=8, frameon=False)
    quiet(axes[-1])
    figure.suptitle(title, color=INK, fontsize=12)
    figure.subplots_adjust(left=0.01, right=0.985, top=0.85, bottom=0.13, wspace=0.12)
    return save(figure, path)
