"""A pulley that is not round about its shaft: eccentric, oval, cornered (physics.md eq. 2)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Profiles, Scene, Usual, onto_bed, waves
from printmend.effects.prior import NEAR_SHARE, harmonics_of, number_of, numbers_of, turning_share
from printmend.effects.words import Care, Fault, Found, Waves, amount, motor_name, stands_out, those_of, where_seen
from printmend.messages import say

HARMONICS = harmonics_of("pulley")
SMOOTH = HARMONICS ** -number_of("pulley", "falls")  # their sizes on most pulleys
NAMED_HARMONICS = 3  # most harmonics of a pulley that are named: the largest
SHAPES = {1: "shape-eccentric", 2: "shape-oval", 3: "shape-three-cornered", 4: "shape-four-cornered"}  # messages


class Pulley(Usual):
    """A Fourier series over one turn of a motor. The shape is the number of its harmonics; an empty shape means all."""

    name = "pulley"
    kinds = ("harmonic",)
    acts = Acts.DRIVE
    keys = Waves(tuple(map(int, HARMONICS)))

    def profiles(self, where: int, scene: Scene) -> Profiles:
        """Return profiles of the harmonics' sizes: usual, smoother, eccentric alone, or those of one symmetry."""
        large = [HARMONICS == 1, *(HARMONICS % fold == 0 for fold in numbers_of(self.name, "folds"))]
        few = [np.where(each, 1.0, number_of(self.name, "beside")) * SMOOTH for each in large]
        return [np.tile(each, 2) for each in (SMOOTH, HARMONICS ** -number_of(self.name, "smoother"), *few)]

    def share(self, where: int, scene: Scene) -> float | None:
        return turning_share(self.name, scene, where)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, waves(places.motor_mm[:, where], scene.turns_mm[where], first(HARMONICS, shape)))

    def waves_mm(self, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return scene.turns_mm[where] / HARMONICS

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        """The largest harmonics c_k; those of a loose belt's play are twice the pulley's odd ones."""
        yield from harmonic_faults(found, beside, scene)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far a pulley moves the lines from side to side, and whether a new one pays."""
        order = int(fault.kind.removeprefix("harmonic-"))
        moves_mm = fault.size / order
        if order == 1:
            title, repair = say("pulley-off-centre", where), say("replace-pulley-if-new-one-wobbles")
            meaning = say("pulley-wobbles", fault.shown, f"{moves_mm:.2f}")
        else:
            title = say("pulley", where, say(SHAPES.get(order, "shape-uneven")))
            repair = say("replace-pulley-worn-squeezed-badly-made")
            meaning = say("pulley-out-of-round", fault.shown, order, f"{moves_mm:.2f}")
        return Care(title, meaning, moves_mm, where_seen(moves_mm, repair))


def first(harmonics: np.ndarray, shape: tuple[float, ...]) -> np.ndarray:
    """Return the first of some harmonics, as many as a shape says, or all."""
    return harmonics[: int(shape[0])] if shape else harmonics


def shape_words(order: int) -> str:
    """Return the shape of a pulley whose error comes so many times a turn."""
    return say(SHAPES[order]) if order in SHAPES else say("shape-uneven-times", order)


def wave_sizes(found: Found) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitudes [K] of a Fourier series, all cosines first, and their standard deviations [K]."""
    cos, sin = found.sizes_mm.reshape(2, -1)
    sds = found.draws_mm.std(axis=1).reshape(2, -1)
    return np.asarray(np.hypot(cos, sin)), np.asarray(np.sqrt(np.mean(sds**2, axis=0)))


def is_loose(breathing: Found, beside: Sequence[Found], scene: Scene) -> bool:
    """Say whether play breathes as on a loose belt rather than as on a pulley that is loose on its shaft.

    The two spans of a loose belt see the pulley from both sides: play has its odd harmonics, the middle of both
    branches its even ones (eq. 6). If a pulley of radius r has slack b on its shaft, play is U(θ + b/2r) - U(θ - b/2r)
    (eq. 10).
    """
    motor = breathing.where
    play = _complex(breathing)
    middle = np.zeros(len(play), complex)
    for each in those_of("pulley", beside, motor):
        waves = _complex(each)[: len(play)]
        middle[: len(waves)] += waves
    slack_mm = sum(float(each.sizes_mm[0]) for each in those_of("play", beside, motor))
    orders = np.arange(1, len(play) + 1)
    of_shaft = 2j * np.tan(np.pi * orders * slack_mm / scene.turns_mm[motor]) * middle
    of_belt = np.where(orders % 2, play, 0.0)
    belt_misses = np.hypot(np.linalg.norm(play - of_belt), np.linalg.norm(2 * middle[::2]))
    return bool(belt_misses < min(np.linalg.norm(play - of_shaft), np.linalg.norm(of_belt)))


def _complex(found: Found) -> np.ndarray:
    """Return a Fourier series as amplitudes [K] of which the real part turns with the pulley."""
    cos, sin = found.sizes_mm.reshape(2, -1)
    return np.asarray(cos - 1j * sin)


def harmonic_faults(found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
    """Name the largest harmonics of the pulley of one motor, once for its own error and that of a loose belt's play."""
    motor = found.where
    loose = [each for each in those_of("breathing", beside, motor) if is_loose(each, beside, scene)]
    parts = [*((each, 1.0) for each in those_of("pulley", beside, motor)), *((each, 0.5) for each in loose)]
    if not parts or parts[0][0] is not found:
        return
    sizes: dict[int, tuple[float, float]] = {}
    for part, share in parts:
        for order, (amplitude, sd) in enumerate(zip(*wave_sizes(part), strict=True), 1):
            if stands_out(share * amplitude, share * sd):
                sizes[order] = max(sizes.get(order, (0.0, 0.0)), (share * amplitude * order, share * sd * order))
    name, turn_mm = motor_name(scene, motor), scene.turns_mm[motor]
    if sizes and abs(turn_mm / scene.printer.axes[motor].mm_per_turn - 1) >= NEAR_SHARE:
        order = max(sizes, key=lambda k: sizes[k][0] / k)
        size, sd = (each / order for each in sizes[order])
        words = say("fault-idler-or-pulley", f"{turn_mm / order:.1f}", amount(size, sd))
        yield Fault(name, f"period-{turn_mm / order:.1f}", size, sd, "mm", words)
        return
    largest = sorted(sizes, key=lambda k: -sizes[k][0])
    finer = len(largest) - NAMED_HARMONICS
    named = sorted(largest[:NAMED_HARMONICS])
    for order in named:
        message = "fault-pulley" if order == named[0] else "fault-harmonic"
        words = say(message, shape_words(order), amount(*sizes[order]))
        if finer > 0 and order == named[-1]:
            words = say("fault-and-finer", words, finer)
        yield Fault(name, f"harmonic-{order}", *sizes[order], "mm", words)
