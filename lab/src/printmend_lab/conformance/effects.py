"""What every effect must keep: the twin makes it by name, prints what its columns say, and learning can see it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import cycle, islice

import numpy as np

from printmend.corruption import Cause, Corruption, cause_of, corruption_toml, parse_corruption
from printmend.corruption.cause import example_of
from printmend.effects import EFFECTS, Acts, Of, columns_of, places_of, scene_of
from printmend.effects.effect import terms_of
from printmend.effects.sized import Sized, scene_of_printer
from printmend.infer.fit import fitted
from printmend.infer.posterior import posterior_of
from printmend.machine import Mechanism, contacts_from, healthy_mechanism
from printmend.path import RESIZED, Trace
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.conformance.need import need
from printmend_lab.sampling import Severity

PRESETS = ("ender3", "corexy")
PLAY_MM = 1.0  # beside what is checked: it keeps the sides apart, and no play below nothing
SMALL_MM = 1e-5
SAME_MM = 1e-9  # a thousandth of what a small size moves
PLACES = 240
DOTS, NOISE_MM = 200, 0.05
FOUND = 0.5
SERIES = 3  # with so many sizes they are known together, not each by itself
MOST_LEFT = 1.15  # of the noise, where another effect stands for one


@dataclass(frozen=True)
class EffectCandidate:
    """An effect by its name."""

    name: str

    def example(self) -> Cause:
        """Return the example that `printmend twin --list` shows."""
        return cause_of(example_of(self.name))

    def twin(self, printer: Printer) -> Twin:
        """Return that printer with the example."""
        return _twin(self.example(), printer)

    def presets(self) -> Iterator[Printer]:
        """Yield the printers that can have it."""
        for preset in PRESETS:
            printer = read_printer(preset)
            if terms_of(EFFECTS[self.name], scene_of_printer(printer)):
                yield printer

    def small(self, printer: Printer, seed: int) -> Sized:
        """Return it with one of its shapes, and sizes of some hundred-thousandths of a millimetre."""
        rng = np.random.default_rng(seed)
        terms = terms_of(EFFECTS[self.name], scene_of_printer(printer))
        term = terms[int(rng.integers(len(terms)))]
        return Sized(self.name, term.where, term.shape, SMALL_MM * rng.standard_normal(len(term.sd_mm)))


@lru_cache(maxsize=len(PRESETS))
def _twin(cause: Cause, printer: Printer) -> Twin:
    return Twin.of(Corruption(causes=(cause,)), printer)


def some_printer_has_it(candidate: EffectCandidate) -> None:
    """A cartesian printer or a CoreXY offers it."""
    need(any(True for _ in candidate.presets()), f"expected terms on one of {', '.join(PRESETS)}")


def is_written_and_read(candidate: EffectCandidate) -> None:
    """The listed example is an equal one after TOML, and lowers on every printer that has it."""
    whole = Corruption(causes=(candidate.example(), Cause(candidate.name, seed=3, severity="realistic")))
    need(parse_corruption(corruption_toml(whole), subject=candidate.name) == whole, "expected equal causes out of TOML")
    for printer in candidate.presets():
        candidate.twin(printer)


def draws_repeat_and_differ(candidate: EffectCandidate, severity: Severity) -> None:
    """One seed draws one effect, another seed another, and a twin can have it."""
    for printer in candidate.presets():
        one, again, other = (_drawn(candidate, severity, seed, printer) for seed in (5, 5, 6))
        need(one.key == again.key and np.array_equal(one.sizes_mm, again.sizes_mm), "expected one seed to draw alike")
        need(not np.array_equal(one.sizes_mm, other.sizes_mm), "expected another seed to draw another")
    for printer in islice(candidate.presets(), 1):
        Twin.of(Corruption(causes=(Cause(candidate.name, seed=5, severity=severity),)), printer)  # type: ignore[arg-type]


def _drawn(candidate: EffectCandidate, severity: Severity, seed: int, printer: Printer) -> Sized:
    return Cause(candidate.name, seed=seed, severity=severity).part(printer)  # type: ignore[arg-type]


def nothing_moves_nothing(candidate: EffectCandidate) -> None:
    """With sizes of zero the twin prints what it prints without the effect, to the last bit."""
    for printer in islice(candidate.presets(), 1):
        part = candidate.small(printer, 1)
        path, (bare, other) = way(printer), _twins(part.of(sizes_mm=0 * part.sizes_mm), printer)
        need(np.array_equal(bare.seen(path), other.seen(path)), "expected no change by sizes of zero")


def the_twin_prints_its_columns(candidate: EffectCandidate) -> None:
    """Beside play, a small effect moves each place of a print by its columns times its sizes."""
    for seed, printer in zip((1, 2), cycle(candidate.presets()), strict=False):
        path, part = way(printer), candidate.small(printer, seed)
        bare, other = _twins(part, printer)
        moved = other.seen(path) - bare.seen(path)
        said = _columns(part, bare.homed(), path) @ part.sizes_mm
        worst = float(np.abs(moved - said).max())
        need(worst < SAME_MM, f"expected places within {SAME_MM:g} mm of the columns, found {worst:.3g} mm off")


def the_bed_inverts(candidate: EffectCandidate) -> None:
    """What a frame does to a place is undone by its inverse; what no machine holds leaves the frame alone."""
    for printer in candidate.presets():
        mechanism = candidate.twin(printer).homed()
        path = way(printer)
        off = np.abs(mechanism.bed.printed(mechanism.bed.wanted(path)) - path).max()
        need(off < 1e-8, f"expected the inverse of the frame within 1e-8 mm, found {off:.3g}")


def the_inverse_of_a_taut_drive_prints_the_path(candidate: EffectCandidate) -> None:
    """Commands out of inverse tables print the wanted places, where the machine holds the effect and has no play."""
    for printer in candidate.presets():
        twin = candidate.twin(printer)
        mechanism = twin.homed()
        if twin.along or not all(table.is_taut for table in mechanism.transmissions):
            continue
        belts = mechanism.bed.wanted(way(printer))
        motors = [
            np.interp(belts[:, k], table.lower_mm, table.motor_mm) for k, table in enumerate(mechanism.transmissions)
        ]
        printed = mechanism.bed.printed(
            np.stack([table.branches_mm(motors[k])[0] for k, table in enumerate(mechanism.transmissions)], axis=1)
        )
        off = np.abs(printed - way(printer)).max()
        need(off < 1e-8, f"expected the inverse within 1e-8 mm, found {off:.3g}")


def the_example_shows(candidate: EffectCandidate) -> None:
    """The example moves a print, or what is measured of it."""
    moved = [_shown_mm(candidate, printer) for printer in candidate.presets()]
    if EFFECTS[candidate.name].of is not Of.MATERIAL:  # the width of a line moves no place
        need(
            max(moved) > 1e-3,
            f"expected a print or a measurement at least 0.001 mm off, found {max(moved):.6f}",
        )


def _shown_mm(candidate: EffectCandidate, printer: Printer) -> float:
    """Return by how much the example moves a flat print at most, or for one of the Z screw a print that rises."""
    twin, path = candidate.twin(printer), way(printer)
    if EFFECTS[candidate.name].acts is not Acts.SCREW:
        return float(np.abs(twin.seen(path) - path).max())
    rising = np.column_stack([path, np.linspace(printer.z.home_mm, printer.z.max_mm, len(path))])
    return float(np.abs(twin.follow(rising)[:, :2] - path).max())


def learning_finds_it(candidate: EffectCandidate) -> str:
    """From dots with 0.05 mm of noise the example is found and its sizes are known, or others leave noise alone.

    Not for effects of the filament, which move walls and no dots.
    """
    law, printer = EFFECTS[candidate.name], next(candidate.presets())
    if law.of is Of.MATERIAL:
        return "not asked: it moves no dots"
    path, dots = _dots(printer)
    seen = candidate.twin(printer).seen(path) + np.random.default_rng(1).normal(0.0, NOISE_MM, path.shape)
    read = law.of is Of.INSTRUMENT
    trace = Trace(
        path,
        np.where(dots[:, None], seen, np.nan),
        homed=True,
        placed=not read,
        instrument=RESIZED if read else None,
        step_mm=scene_of_printer(printer).step_mm if read else 0.0,
    )
    scene = scene_of(trace, printer)
    fit = fitted(trace, scene)
    parts = posterior_of(fit, np.random.default_rng(0)).parts
    true = candidate.example().part(printer)
    found = [part for part in parts if part.effect == candidate.name and part.where == true.where]
    if sum(part.chance for part in found) > FOUND:
        best = max(found, key=lambda part: part.chance)
        if best.shape == true.shape and len(true.sizes_mm) < SERIES and not read:
            sd_mm = best.draws_mm[:, best.draws_mm.any(axis=0)].std(axis=1)
            near = np.abs(best.mean_mm / best.chance - true.sizes_mm) < 5 * sd_mm + 2e-3
            need(near.all(), f"expected sizes near {true.sizes_mm}, found {best.mean_mm} ± {sd_mm}")
        return ""
    left_mm = float(np.sqrt(np.nanmean(np.square(fit.left_by_mark_mm(trace)))))
    need(left_mm < MOST_LEFT * NOISE_MM, f"expected it found, or noise alone left; found {left_mm:.3f} mm left")
    return f"others stand for it: {left_mm:.3f} mm left, as much as the noise"


def _dots(printer: Printer) -> tuple[np.ndarray, np.ndarray]:
    """Return way-points [N, 2] mm all over the bed, approached from every side, and which of them leave a dot."""
    rng = np.random.default_rng(4)
    low, high = np.array([[axis.min_mm, axis.max_mm] for axis in printer.axes[:2]]).T
    dots = low + rng.uniform(0.08, 0.92, (DOTS, 2)) * (high - low)
    before = dots + rng.choice([-4.0, 4.0], (DOTS, 2))
    path = np.concatenate([np.array(printer.home_mm)[None], np.stack([before, dots], axis=1).reshape(-1, 2)])
    return path, (np.arange(len(path)) % 2 == 0) & (np.arange(len(path)) > 0)


def _twins(part: Sized, printer: Printer) -> tuple[Twin, Twin]:
    """Return the twin with play alone, and with this effect beside it."""
    bare = _with_play(printer)
    return bare, bare.with_effects([part])


@lru_cache(maxsize=len(PRESETS))
def _with_play(printer: Printer) -> Twin:
    play = [Sized("play", motor, (), np.array([PLAY_MM])) for motor in range(2)]
    return Twin(healthy_mechanism(printer)).with_effects(play)


def _columns(part: Sized, homed: Mechanism, path_mm: np.ndarray) -> np.ndarray:
    """Return what one unit of each size moves [N, 2, P] mm along a path on a homed machine."""
    printer = homed.printer
    scene = scene_of_printer(printer, float(np.hypot(*np.diff(path_mm, axis=0).T).sum()))
    ways_home = [printer.motor_home_direction(motor) for motor in range(2)]
    contacts = contacts_from(homed, printer.to_motor(path_mm), ways_home)
    trace = Trace(path_mm, np.full(path_mm.shape, np.nan), homed=True)
    places = places_of(trace, scene, contacts.row, contacts.side, printer.from_motor(contacts.belt_mm))
    return columns_of(part.effect, places, part.where, part.shape, scene)


@lru_cache(maxsize=len(PRESETS))
def way(printer: Printer) -> np.ndarray:
    """Return way-points [N, 2] mm from home on micro-steps. Each motor stands still or goes farther than its play."""
    rng = np.random.default_rng(2)
    axes = printer.axes[:2]
    low, high = (np.array([getattr(axis, end) for axis in axes]) for end in ("min_mm", "max_mm"))
    fine = np.array([axis.mm_per_step / axis.microsteps for axis in axes])
    motors = [printer.to_motor(np.array(printer.home_mm, float))]
    while len(motors) < PLACES:
        wanted = printer.to_motor(low + rng.uniform(0.05, 0.95, 2) * (high - low))
        wanted = np.where(
            rng.uniform(size=2) < 0.25, motors[-1], motors[0] + np.rint((wanted - motors[0]) / fine) * fine
        )
        step, place = np.abs(wanted - motors[-1]), printer.from_motor(wanted)
        if ((step == 0) | (step > 3 * PLAY_MM)).all() and step.any() and ((place >= low) & (place <= high)).all():
            motors.append(wanted)
    return np.asarray(printer.from_motor(np.array(motors)))


CHECKS: dict[str, Callable[[EffectCandidate], str | None]] = {
    "some printer has it": some_printer_has_it,
    "the listed example is written and read": is_written_and_read,
    "draws repeat and differ (damaged)": partial(draws_repeat_and_differ, severity="damaged"),
    "draws repeat and differ (realistic)": partial(draws_repeat_and_differ, severity="realistic"),
    "sizes of zero move nothing": nothing_moves_nothing,
    "the twin prints its columns": the_twin_prints_its_columns,
    "the frame inverts": the_bed_inverts,
    "a taut drive inverts": the_inverse_of_a_taut_drive_prints_the_path,
    "the example shows": the_example_shows,
    "learning finds it": learning_finds_it,
}
