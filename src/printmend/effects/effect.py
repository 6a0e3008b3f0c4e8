"""The definition of an effect: one cause of error with its linear columns, its prior and its fate in the next print.

An effect offers `Term`s: itself at one motor or axis, with one shape (a period, a break, a length). A term has P
columns: how far each mark moves on the bed [mm] for one unit of each of its P sizes. Inference, the twin, the promise
and the model file read these columns and nothing else.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from printmend.path import Instrument, Trace, last_way
from printmend.printer import Printer

LONG_MM = 10.0  # on longer moves the head reaches its speed: on those of a part, and to the end stops
STRAIGHT = 0.98  # cosine of the angle up to which a move goes on: 11°, at which no firmware brakes for much
ALWAYS = 1e3  # logarithm of the odds of an effect that every print or measurement has
SCALE_MM = 100.0  # slopes are in mm per this distance, as in the model file
# Effects that are linear in the place on the bed: a scanner's own stretch looks like them, and several like several.
LINEAR = ("scale", "skew", "aspect", "turn", "resized")
SHIFTS = ("place", "origin", "shift")  # effects that move everything alike
FEW_LAYERS, MOST_LAYERS = 3, 48  # heights; fewer show nothing of the screw, and with more, neighbours share a size
STROKES = 4  # of a motor that are known at a place: what was before them has faded
TINY_MM = 1e-9  # what a model file rounds to
HARDLY_ANY, NEARLY_ALL = 0.05, 0.95  # shares that count as none and as all, as of the drawn machines
SEED = 0  # of draws that are always the same: what they answer must not change from one time to the next
FAR_MM = 30.0  # standard deviation of a place that nothing ties to the end stops


class Of(Enum):
    """Whose error an effect is. That decides whether it acts, and its fate."""

    MACHINE = "machine"  # acts again in every print
    SESSION = "session"  # of this print only, or begins anew in each
    INSTRUMENT = "instrument"  # of the measurement: never acts, and is no error of the print
    MATERIAL = "material"  # goes with the filament

    @property
    def is_printers(self) -> bool:
        """Tell whether the printer makes it, if only in this print."""
        return self in (Of.MACHINE, Of.SESSION)


class Acts(Enum):
    """The part of a mechanism that holds an effect, so that mending can undo it."""

    DRIVE = "drive"  # the two tables of a motor: it depends on the motor's place and side alone
    FRAME = "frame"  # the polynomials of the frame: it depends on the place on the bed alone
    WAVE = "wave"  # a wave of the frame
    SCREW = "screw"  # the push of the Z screw: it depends on the height alone
    NOT = "not"  # nothing: it is promised, and told


@dataclass(frozen=True)
class Fate:
    """The fate of an effect in the next print: the probability that it begins anew, and that it continues from where
    the measured print left it. Otherwise it is gone, for example by homing. An effect that begins anew repeats its
    course, or, if ``otherwise``, takes another one of the same size with either sign."""

    anew: float = 0.0
    stays: float = 0.0
    otherwise: bool = False


ANEW, STAYS, GONE = Fate(anew=1.0), Fate(stays=1.0), Fate()
OTHERWISE = Fate(anew=1.0, otherwise=True)


@dataclass(frozen=True)
class Scene:
    """The measured machine and the spans that it covered.

    ``turns_mm`` are the lengths of both motors' turns. ``motor_span_mm`` [2][2] and ``bed_span_mm`` [2][2] are the
    lowest and highest measured position of each motor and bed axis; ``way_mm`` is the length of the print, of which the
    share ``unseen_share`` came before the first mark. ``homed``: it began at the end stops, where the machine has no
    error; ``home_sd_mm`` is the standard deviation of each belt's place there. ``homed_again_mm`` are observed shifts
    between two homings along one axis, each with its standard deviation.
    ``layers`` are the lowest and the highest layer [mm] and how many were measured, empty for fewer than `FEW_LAYERS`.
    ``shrinkage_sd`` is the uncertainty of the measured part's shrinkage, as a share; None where nothing can shrink.
    ``longest_mm`` is the longest move that led to a mark, at most `LONG_MM`; ``step_mm`` is the trace's.
    """

    printer: Printer
    turns_mm: tuple[float, float]
    motor_span_mm: tuple[tuple[float, float], tuple[float, float]]
    bed_span_mm: tuple[tuple[float, float], tuple[float, float]]
    way_mm: float
    placed: bool = True
    homed: bool = False
    home_sd_mm: tuple[float, float] = (FAR_MM, FAR_MM)
    instrument: Instrument = field(default_factory=Instrument)
    walls: bool = False
    homed_again_mm: tuple[tuple[float, float], ...] = ()
    shrinkage_sd: float | None = None
    layers: tuple[float, ...] = ()
    unseen_share: float = 0.0
    longest_mm: float = LONG_MM
    step_mm: float = 0.0

    @property
    def corexy(self) -> bool:
        return self.printer.kinematics == "corexy"

    @cached_property
    def belt_ways(self) -> np.ndarray:
        """How far each belt moves the head along either bed axis, for one mm [2, 2]."""
        return np.asarray(self.printer.from_motor(np.eye(2)))

    @property
    def middle_mm(self) -> np.ndarray:
        """The middle of the bed [2]."""
        return np.array(self.printer.middle_mm[:2], float)

    def motor_middle_mm(self, motor: int) -> float:
        """The position of a motor at the middle of the bed, from which its slopes are counted."""
        return float(self.printer.to_motor(self.middle_mm)[motor])

    def off_middle(self, bed_mm: np.ndarray) -> np.ndarray:
        """Return how far places on the bed [..., 2] are from its middle, in `SCALE_MM`."""
        return np.asarray((bed_mm - self.middle_mm) / SCALE_MM)

    def motor_off_middle(self, motor: int, motor_mm: np.ndarray | float) -> np.ndarray:
        """Return how far positions of a motor [...] are from that at the middle of the bed, in `SCALE_MM`."""
        return np.asarray((motor_mm - self.motor_middle_mm(motor)) / SCALE_MM)


@dataclass(frozen=True, eq=False)
class Places:
    """N places of a print, with all that effects depend on.

    ``motor_mm`` [N, 2] is where each motor was when it last moved its belt, ``side`` [N, 2] the branch that it touched:
    −1 pushed forwards, +1 pulled back, 0 not known. ``bed_mm`` [N, 2] is the position of the belts on the bed, ``ways``
    [N, 2] the direction in which each bed axis last moved. ``done`` [N] is the length printed so far over that of the
    measured print; ``move_mm`` [N] the length of the last move up to there. ``normal`` [N, 2] points out of a wall's
    plastic, 0 for other marks; ``z_mm`` [N] is the height, None for home's. ``heading`` [N, 2] is the direction of the
    last move on the bed, of length 1, None for half-way between the axes'. ``strokes_mm`` [N, 2, STROKES] is how far
    each motor has gone since its last reversal, since the one before it, and so on, infinite before the first; None
    where all are far back.
    """

    motor_mm: np.ndarray
    side: np.ndarray
    bed_mm: np.ndarray
    ways: np.ndarray
    done: np.ndarray
    move_mm: np.ndarray
    normal: np.ndarray
    z_mm: np.ndarray | None = None
    heading: np.ndarray | None = None
    strokes_mm: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.motor_mm)

    def at(self, rows: np.ndarray) -> "Places":
        """Return some of the places."""
        return replace(self, **{name: value[rows] for name, value in vars(self).items() if value is not None})

    def headings(self) -> np.ndarray:
        """Return the direction of the last move to each place [N, 2], of length 1, or 0 before the first."""
        way = self.ways if self.heading is None else self.heading
        return np.asarray(way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9))

    def heights_mm(self, scene: Scene) -> np.ndarray:
        """Return the height of each place [N]."""
        return np.full(len(self), scene.printer.z.home_mm) if self.z_mm is None else self.z_mm


Key = tuple[str, int, tuple[float, ...]]  # an effect, where it is, and its shape
Shapes = Sequence[tuple[float, ...]]
Profiles = Sequence[Iterable[float]]


@dataclass(frozen=True)
class Term:
    """One effect at one motor or axis ``where`` with one ``shape``.

    ``sd_mm`` [P] are the prior standard deviations of its sizes on a damaged machine. ``log_odds`` is the logarithm of
    the prior odds that the machine has it, shared among the alternatives of the same effect and place. A set has at
    most one term of each ``slot``. Where only sizes above 0 have a meaning ``sign`` is 1, where only those below, −1.
    """

    effect: str
    where: int
    shape: tuple[float, ...]
    sd_mm: tuple[float, ...]
    log_odds: float
    sign: int = 0

    @property
    def key(self) -> Key:
        return self.effect, self.where, self.shape


class Effect(Protocol):
    """One cause of error; see `docs/adding_an_effect.md`."""

    @property
    def name(self) -> str: ...

    @property
    def of(self) -> Of: ...

    @property
    def acts(self) -> Acts: ...

    @property
    def fate(self) -> "Fate":
        """Its fate in the next print."""
        ...

    @property
    def from_home(self) -> bool:
        """Say whether homing removes its error at home."""
        ...

    @property
    def most(self) -> int:
        """How many terms of this effect one place may have."""
        ...

    def terms(self, scene: Scene) -> Iterator[Term]:
        """Yield the terms that a machine may have, each with its prior: the same ones for equal scenes."""
        ...

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        """Return how far the places move [N, 2, P] mm for one unit of each size."""
        ...

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        """Yield shapes about a found one, between the alternatives of the grid."""
        ...


class Usual:
    """The usual answers of an effect: it is of the machine, nothing holds it, and it stays. Homing removes its error at
    home. Either motor or axis may have it, with sizes of either sign, as the table of priors has them, and without a
    shape."""

    name: str
    of = Of.MACHINE
    acts = Acts.NOT
    fate = STAYS
    from_home = True
    most = 1
    positive = False
    below = ""

    def carriers(self, scene: Scene) -> range:
        """Return the motors or axes that may have it."""
        return range(2)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        """Return the shapes that are tried there, as alternatives of one another."""
        return [()]

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        """Return how far it is in each number of a shape to the next one that is tried, 0 where none is between."""
        return ()

    def is_possible(self, where: int, shape: tuple[float, ...], scene: Scene) -> bool:
        """Tell whether it may have a shape there, of those that are tried or between them."""
        return True

    def profiles(self, where: int, scene: Scene) -> Profiles:
        """Return the alternative standard deviations [P] of its sizes, over the usual one; the table's for none."""
        return ()

    def share(self, where: int, scene: Scene) -> float | None:
        """Return the share of printers that have it there, None for the table's."""
        return None

    def terms(self, scene: Scene) -> Iterator[Term]:
        from printmend.effects.prior import alternatives  # which makes terms

        for where in self.carriers(scene):
            shapes = [each for each in self.shapes(where, scene) if self.is_possible(where, each, scene)]
            profiles, share = self.profiles(where, scene), self.share(where, scene)
            yield from alternatives(self.name, where, shapes, *profiles, share=share, sign=int(self.positive))
            if self.below:
                yield from alternatives(self.name, where, shapes, row=self.below, sign=-1)

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        for at, apart in enumerate(self.spacing(where, shape, scene)):
            for number in (shape[at] + apart * FINER / TIMES_FINER**round_).tolist():
                near = (*shape[:at], number, *shape[at + 1 :])
                if apart and self.is_possible(where, near, scene):
                    yield near


def waves(place_mm: np.ndarray, period_mm: float, harmonics: Sequence[int] | np.ndarray = (1,)) -> np.ndarray:
    """Return cos kφ and sin kφ [N, 2K] of places, φ a turn each ``period_mm``: first all cosines, then all sines.

    They are the powers of cos φ + i sin φ (de Moivre); ``harmonics`` [K] are whole numbers from 1 on.
    """
    orders = np.asarray(harmonics, np.intp)
    powers = np.exp(2j * np.pi / period_mm * np.asarray(place_mm))[:, None]
    if orders.max() > 1:
        every = np.broadcast_to(powers, (len(powers), orders.max()))
        powers = np.multiply.accumulate(every, axis=1)[:, orders - 1]
    return np.concatenate([powers.real, powers.imag], axis=1)


def onto_bed(scene: Scene, motor: int, belt_mm: np.ndarray) -> np.ndarray:
    """Return what shifts [N, P] of one motor's belt do on the bed [N, 2, P]."""
    return belt_mm[:, None, :] * scene.belt_ways[motor, :, None]


def along(axis: int, moved_mm: np.ndarray) -> np.ndarray:
    """Return shifts [N, P] along a bed axis as [N, 2, P]."""
    out = np.zeros((len(moved_mm), 2, moved_mm.shape[1]))
    out[:, axis] = moved_mm
    return out


def along_both(moved_mm: np.ndarray) -> np.ndarray:
    """Return shifts [N, P] along either bed axis as [N, 2, 2P]: those along x first."""
    return np.concatenate([along(0, moved_mm), along(1, moved_mm)], axis=2)


def held(places_mm: np.ndarray, span_mm: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return places, those outside of a span moved to its ends, so that the effect stays constant there."""
    low, high = span_mm
    return np.clip(places_mm, low, high)


def at_places(**known: np.ndarray) -> Places:
    """Return places [N] of which only this is known; everything else is 0, and no place is on a wall."""
    count = len(next(iter(known.values())))
    two, one = np.zeros((count, 2)), np.zeros(count)
    unknown = {"motor_mm": two, "side": two, "bed_mm": two, "ways": two, "normal": two}
    return Places(**{**unknown, "done": one, "move_mm": one, **known})


def belt_places(motor: int, motor_mm: np.ndarray, side: np.ndarray | float) -> Places:
    """Return places [N] of one motor's belt on a side of its play, at the end of a print."""
    at, sides = np.zeros((2, len(motor_mm), 2))
    at[:, motor], sides[:, motor] = motor_mm, side
    return at_places(motor_mm=at, side=sides, done=np.ones(len(at)))


@lru_cache(maxsize=16)
def home_of(scene: Scene) -> Places:
    """Return the place [1] at which the end stops leave the machine, each belt engaged as its motor came."""
    printer = scene.printer
    home = np.array(printer.home_mm)[None]
    motor_ways = np.array([[float(printer.motor_home_direction(motor)) for motor in range(2)]])
    ways = np.sign(printer.from_motor(motor_ways))
    return at_places(
        motor_mm=printer.to_motor(home), side=-motor_ways, bed_mm=home, ways=ways, move_mm=np.full(1, LONG_MM)
    )


def places_of(trace: Trace, scene: Scene, contact_row: np.ndarray, side: np.ndarray, bed_mm: np.ndarray) -> Places:
    """Return the rows of a trace as places.

    ``contact_row`` [N, 2] is the row of each motor's last contact and ``side`` [N, 2] its branch; ``bed_mm`` [N, 2] is
    where a model puts the belts.
    """
    motor = scene.printer.to_motor(trace.commanded_mm)
    at = np.where(contact_row >= 0, contact_row, np.arange(len(motor))[:, None])  # else about where the motor is
    step, heading, move_mm = moves_of(trace.commanded_mm)
    at_home = home_of(scene).side[0] if scene.homed else np.zeros(2)
    side = np.where(contact_row >= 0, np.where(side == 0, at_home, side), 0).astype(np.float32)
    motor_mm = np.take_along_axis(motor, at, axis=0)
    return Places(
        motor_mm=motor_mm,
        side=side,
        bed_mm=bed_mm,
        ways=last_way(trace.commanded_mm).astype(np.float32),
        done=done_of(step, scene),
        move_mm=move_mm,
        normal=np.broadcast_to(0.0, (len(step), 2)) if trace.normal is None else np.nan_to_num(trace.normal),
        z_mm=None if trace.z_mm is None else np.nan_to_num(trace.z_mm, nan=scene.printer.z.home_mm),
        heading=heading,
        strokes_mm=strokes_of(motor_mm, side, at_home),
    )


def moves_of(path_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return of each row of a path [N, 2] the way from the row before [N], the direction of the last move [N, 2], of
    length 1, and that move's length up to there [N]: through all rows on a line that goes on, without a stop."""
    ways = np.diff(path_mm, axis=0, prepend=path_mm[:1])
    step = np.hypot(*ways.T)
    heading = ways / np.maximum(step[:, None], 1e-9)
    goes_on = np.einsum("nc,nc->n", heading[1:], heading[:-1]) > STRAIGHT
    gone = np.cumsum(step)
    begins = np.concatenate([[True], ~goes_on]) & (step > 0)
    began = np.maximum.accumulate(np.where(begins, gone - step, 0.0))
    last = np.maximum.accumulate(np.where(step > 0, np.arange(len(step)), 0))
    return step, heading[last], (gone - began)[last]


def strokes_of(motor_mm: np.ndarray, side: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return how far each motor has gone since its last reversals [N, 2, STROKES], the last one first, infinite before
    the first. It turns round where its ``side`` [N, 2] changes; ``before`` [2] is its side before the first row."""
    strokes = np.empty((*side.shape, STROKES), np.float32)
    for motor, (places_mm, sides) in enumerate(zip(motor_mm.T, side.T, strict=True)):
        gone_mm = np.concatenate([[0.0], np.abs(np.diff(places_mm, prepend=places_mm[:1])).cumsum()])
        known = np.concatenate([before[motor : motor + 1], sides])
        known = known[np.maximum.accumulate(np.where(known != 0, np.arange(len(known)), 0))]
        turned = known[1:] * known[:-1] < 0
        began_mm = np.concatenate([np.full(STROKES, -np.inf), gone_mm[:-1][turned]])
        for back in range(STROKES):
            strokes[:, motor, back] = gone_mm[1:] - began_mm[STROKES - 1 - back + np.cumsum(turned)]
    return strokes


def done_of(step_mm: np.ndarray, scene: Scene) -> np.ndarray:
    """Return the length printed before each row [N], over that of the measured print, from the moves' lengths [N]."""
    return np.cumsum(step_mm) / max(scene.way_mm, 1e-9)


def scene_of(trace: Trace, printer: Printer, turns_mm: tuple[float, float] | None = None) -> Scene:
    """Return the scene of a trace; motors turn as the printer says, unless ``turns_mm`` says otherwise."""
    known = trace.measured_rows | trace.wall_rows
    bed = trace.commanded_mm[known]
    motor = printer.to_motor(bed)

    def spans(places: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
        low, high = places.min(axis=0), places.max(axis=0)
        return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))

    steps, _, moves_mm = moves_of(trace.commanded_mm)
    way, unseen = float(steps[1:].sum()), float(steps[1:][: int(np.argmax(known))].sum())
    longest_mm = float(moves_mm[known].max(initial=0.0)) or LONG_MM
    return Scene(
        printer, turns_mm or printer.mm_per_turn, spans(motor), spans(bed), way, trace.placed, trace.homed,
        instrument=trace.instrument_doubt, walls=bool(trace.wall_rows.any()), shrinkage_sd=trace.shrinkage_sd,
        layers=() if trace.z_mm is None else layers_of(trace.z_mm[known]), unseen_share=unseen / max(way, 1e-9),
        longest_mm=min(longest_mm, LONG_MM), step_mm=trace.step_mm,
    )  # fmt: skip


def layers_of(z_mm: np.ndarray) -> tuple[float, ...]:
    """Return the lowest and the highest of the heights [N] of marks, and how many there are."""
    heights = np.unique(np.round(z_mm[np.isfinite(z_mm)], 3))
    few = len(heights) < FEW_LAYERS
    return () if few else (float(heights[0]), float(heights[-1]), float(min(len(heights), MOST_LAYERS)))


def carrier(scene: Scene, where: int, moved_mm: np.ndarray) -> np.ndarray:
    """Return shifts [N, P] of motor ``where`` (0, 1) or of bed axis ``where − 2`` as [N, 2, P]."""
    return onto_bed(scene, where, moved_mm) if where < 2 else along(where - 2, moved_mm)


# How fine the grids of shapes are, and how much finer a grid about a shape that was found.

FINER = np.array([-0.5, -0.25, 0.25, 0.5])  # numbers about one of a found shape, in spacings of its grid
TIMES_FINER = float(len(FINER))
STEPS = 50  # parts of a span between steps that are tried: far from any, smooth effects look likelier than a step
CYCLES = 0.25  # by which two neighbouring periods of a grid differ over the whole span


def steps(low: float, high: float) -> list[float]:
    """Return the places or moments of a step that are tried between the ends of a span."""
    return np.linspace(low, high, STEPS + 1)[2:-2].tolist()


def periods_mm(shortest_mm: float, longest_mm: float, span_mm: float) -> list[float]:
    """Return periods of which each differs from the next by a quarter of a wave over a span."""
    if longest_mm <= shortest_mm:
        return []
    found: list[float] = (1.0 / np.arange(1.0 / longest_mm, 1.0 / shortest_mm, CYCLES / span_mm)).tolist()
    return found


def periods_apart_mm(period_mm: float, span_mm: tuple[float, float]) -> float:
    """Return how far the next period is from one over a span from one end to the other."""
    return CYCLES * period_mm**2 / (span_mm[1] - span_mm[0])


# Draw an effect from its prior; draw places over the measured spans, to judge an effect's size on.

COUNT = 600  # of the places


def drawn_places(scene: Scene) -> Places:
    """Return places over the measured spans, each reached from either side, by short and by long moves."""
    rng = np.random.default_rng(SEED)
    low, high = np.array(scene.bed_span_mm).T
    bed = rng.uniform(low, high, (COUNT, 2))
    side, ways = rng.choice([-1.0, 1.0], (2, COUNT, 2))
    normal = rng.standard_normal((COUNT, 2))
    return Places(
        scene.printer.to_motor(bed), side, bed, ways, rng.uniform(0, 1, COUNT),
        rng.choice([1.0, LONG_MM], COUNT), normal / np.linalg.norm(normal, axis=1, keepdims=True),
        np.linspace(scene.layers[0], scene.layers[1], COUNT) if scene.layers else None, rng.standard_normal((COUNT, 2)),
        rng.choice([1.0, LONG_MM], (COUNT, 2, STROKES)).cumsum(axis=2),
    )  # fmt: skip


def terms_of(effect: Effect, scene: Scene) -> list[Term]:
    """Return an effect's terms on a machine, in a measurement with a place or without, or by an unknown instrument."""
    scenes = (scene, replace(scene, placed=False), replace(scene, instrument=Instrument()))
    return next(filter(None, (list(effect.terms(each)) for each in scenes)), [])


def drawn_term(terms: list[Term], rng: np.random.Generator) -> tuple[Term, np.ndarray]:
    """Draw one of some terms for a damaged machine: its shape evenly, its sizes [P] by the prior.

    The mild alternatives of a shape are left out: those whose sizes are nearer to a mild one's, as priors.toml has it.
    """
    from printmend.effects.prior import mild_shares  # which makes terms

    _, mild, *_ = mild_shares()
    shape = terms[int(rng.integers(len(terms)))].shape
    alike = [term for term in terms if term.shape == shape]
    most = max(float(np.linalg.norm(term.sd_mm)) for term in alike)
    alike = [term for term in alike if np.linalg.norm(term.sd_mm) > math.sqrt(mild) * most]
    term = alike[int(rng.integers(len(alike)))]
    return term, drawn_sizes(term, rng)


def drawn_sizes(term: Term, rng: np.random.Generator) -> np.ndarray:
    """Draw the sizes [P] of a term by its prior."""
    sizes = np.array(term.sd_mm) * rng.standard_normal(len(term.sd_mm))
    return term.sign * np.abs(sizes) if term.sign else sizes


def held_mm(effect: Effect, sizes_mm: np.ndarray) -> np.ndarray:
    """Return what of an effect's sizes [P, ...] a mechanism holds, 0 for the rest."""
    if effect.acts is Acts.NOT:
        return np.zeros_like(sizes_mm)
    return np.maximum(sizes_mm, 0.0) if getattr(effect, "below", "") else sizes_mm


def name_of(effect: Effect, sizes_mm: np.ndarray) -> str:
    """Return what an effect is called: with sizes below 0 it may be another one."""
    return (np.mean(sizes_mm) < 0 and getattr(effect, "below", "")) or effect.name
