"""The parameters of a motor's drive and the columns that they multiply: which parts there are, in which order."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from printmend.model.branches import SCALE_MM, Branches, Wave, warp_angle
from printmend.path import frozen
from printmend.printer import Printer
from printmend.units import TURN_RAD

TABLE_PHASES = 4096  # phases of the tables over a turn with which the play is followed
CROSS = ((0, 1), (0, 2), (1, 1), (0, 3), (1, 2), (2, 1))  # exponents (own, other) of the frame's terms


def warp_columns(count: int, span_mm: tuple[float, float], motor_mm: np.ndarray) -> np.ndarray:
    """Return cos(k π t) [N, count] for k = 1…count at places t of a span."""
    return np.cos(warp_angle(span_mm, motor_mm)[:, None] * np.arange(1, count + 1))


@dataclass(frozen=True)
class Design:
    """The columns of a motor's drive, in the order of its parameters.

    The parameters are: where the belt was at the start (counted from the first measurement), powers of the mean, powers
    of the play, cross terms, warp, cosines and sines of the ripple and of the second period, then cosines and sines of
    the harmonics of mean, play and elastic. ``cross`` are the exponents (own, other) of the frame's terms, other ≥ 1.
    ``warp`` is the number of cosines over ``warp_span_mm`` that describe the part of the mean without a period.
    ``ripple`` are the high harmonics of micro-step ripple. ``second`` harmonics are those of ``second_mm``, a length
    other than the motor's turn. ``elastic`` harmonics grow along the axis (physics.md eq. 8).
    """

    mean_powers: int = 0
    play_powers: int = 0
    cross: tuple[tuple[int, int], ...] = ()
    ripple: tuple[int, ...] = ()
    mean_harmonics: tuple[int, ...] = ()
    play_harmonics: tuple[int, ...] = ()
    elastic_harmonics: tuple[int, ...] = ()
    warp: int = 0
    warp_span_mm: tuple[float, float] = (0.0, 1.0)
    second_harmonics: tuple[int, ...] = ()
    second_mm: float = 0.0

    @cached_property
    def parts(self) -> dict[str, slice]:
        """The slice of every part in the parameter vector."""
        sizes = {
            "start": 1,
            "mean_powers": self.mean_powers,
            "play_powers": self.play_powers,
            "cross": len(self.cross),
            "warp": self.warp,
            "ripple_cos": len(self.ripple),
            "ripple_sin": len(self.ripple),
            "second_cos": len(self.second_harmonics),
            "second_sin": len(self.second_harmonics),
            "mean_cos": len(self.mean_harmonics),
            "mean_sin": len(self.mean_harmonics),
            "play_cos": len(self.play_harmonics),
            "play_sin": len(self.play_harmonics),
            "elastic_cos": len(self.elastic_harmonics),
            "elastic_sin": len(self.elastic_harmonics),
        }
        parts, first = {}, 0
        for name, size in sizes.items():
            parts[name] = slice(first, first + size)
            first += size
        return parts

    @cached_property
    def size(self) -> int:
        return self.parts["elastic_sin"].stop

    @cached_property
    def extras(self) -> int:
        """The number of columns that are no harmonics of mean, play or elastic: they come first."""
        return self.parts["mean_cos"].start

    @property
    def place_at(self) -> int:
        """The number of the parameter that shifts the whole belt: the constant of the mean."""
        return self.parts["mean_powers"].start

    @property
    def scale_at(self) -> int:
        """The number of the parameter that is the belt's scale [mm in 100 mm]: the slope of the mean."""
        return self.place_at + 1

    @property
    def play_at(self) -> int:
        """The number of the parameter that is the play at the axis' middle: the constant of the play."""
        return self.parts["play_powers"].start

    def wave_at(self, name: str, which: int) -> list[int]:
        """Return the numbers of cosine and sine of one harmonic of ripple, second, mean, play or elastic.

        ``which`` counts from 0 within `waves` of that name: it is not the harmonic itself.
        """
        return [self.parts[f"{name}_{wave}"].start + which for wave in ("cos", "sin")]

    @cached_property
    def harmonic(self) -> np.ndarray:
        """The harmonic of every parameter [P], 0 where it has none."""
        order = np.zeros(self.size, np.int64)
        for name, part in self.parts.items():
            if name.endswith(("_cos", "_sin")):
                order[part] = self.waves(name)
        return order

    def waves(self, name: str) -> np.ndarray:
        """Return the harmonics of ripple, second, mean, play or elastic (of ``mean_cos``, too)."""
        return _waves(self, name.removesuffix("_cos").removesuffix("_sin"))

    def mask(self, *names: str) -> np.ndarray:
        """Mark the parameters [P] of the named parts; "mean" stands for mean_cos and mean_sin."""
        marked = np.zeros(self.size, bool)
        for name in names:
            for part in (name,) if name in self.parts else (f"{name}_cos", f"{name}_sin"):
                marked[self.parts[part]] = True
        return marked

    def moved(self, values: np.ndarray, other: "Design") -> np.ndarray:
        """Carry parameters [..., P] of ``other`` over to this design; new ones are 0."""
        mine, theirs = _shared(self, other)
        moved = np.zeros((*values.shape[:-1], self.size))
        moved[..., mine] = values[..., theirs]
        return moved

    def _keys(self, name: str) -> list:
        if name in ("cross", "start"):
            return list(self.cross) if name == "cross" else [0]
        if name == "warp":
            return [(k, *self.warp_span_mm) for k in range(1, self.warp + 1)]
        if name.startswith("second"):
            return [(k, self.second_mm) for k in self.second_harmonics]
        return list(range(getattr(self, name)) if name.endswith("_powers") else self.waves(name))

    def branches(
        self, values: np.ndarray, *, period_mm: float, origin_mm: float, reach_mm: tuple[float, float]
    ) -> Branches:
        """Return the drive that parameters [P] stand for."""
        at = {name: values[part] for name, part in self.parts.items()}
        return Branches(
            period_mm,
            origin_mm,
            reach_mm,
            Wave(
                at["mean_powers"],
                np.concatenate([self.waves("mean"), self.waves("ripple")]),
                np.concatenate([at["mean_cos"], at["ripple_cos"]]),
                np.concatenate([at["mean_sin"], at["ripple_sin"]]),
            ),
            Wave(at["play_powers"], self.waves("play"), at["play_cos"], at["play_sin"]),
            Wave(np.zeros(0), self.waves("elastic"), at["elastic_cos"], at["elastic_sin"]),
            at["warp"],
            self.warp_span_mm,
            Wave(np.zeros(0), self.waves("second"), at["second_cos"], at["second_sin"]),
            self.second_mm,
        )

    def columns(self, motor_mm: np.ndarray, period_mm: float, origin_mm: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns of mean and of play [N, P] at motor positions [N]; the frame's are 0 in both."""
        x = (motor_mm - origin_mm) / SCALE_MM
        phase = TURN_RAD * np.mod(motor_mm / period_mm, 1.0)
        mean, play = np.zeros((len(x), self.size)), np.zeros((len(x), self.size))
        mean[:, self.parts["mean_powers"]] = x[:, None] ** np.arange(self.mean_powers)
        mean[:, self.parts["warp"]] = warp_columns(self.warp, self.warp_span_mm, motor_mm)
        play[:, self.parts["play_powers"]] = x[:, None] ** np.arange(self.play_powers)
        harmonics = np.unique(self.harmonic[self.harmonic > 0])
        once, turned_rows = np.exp(1j * phase), np.empty((len(harmonics), len(x)), complex)
        for at, k in enumerate(harmonics):  # eⁱᵏᵠ = eⁱ⁽ᵏ⁻¹⁾ᵠ eⁱᵠ: far cheaper than cosines and sines of all
            follows = at > 0 and harmonics[at - 1] == k - 1
            turned_rows[at] = turned_rows[at - 1] * once if follows else np.exp(1j * k * phase)
        turned = {"cos": turned_rows.real.T, "sin": turned_rows.imag.T}
        cosines, sines = self.second_columns(motor_mm)
        mean[:, self.parts["second_cos"]], mean[:, self.parts["second_sin"]] = cosines, sines
        for name, part in self.parts.items():
            if name.endswith(("_cos", "_sin")) and not name.startswith("second"):
                wave = turned[name[-3:]][:, np.searchsorted(harmonics, self.waves(name))]
                into = play if name.startswith("play") else mean
                into[:, part] = wave * x[:, None] if name.startswith("elastic") else wave
        return mean, play

    def second_columns(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the cosines and the sines [N, S] of the second period at motor positions [N]."""
        angle = np.outer(motor_mm, self.waves("second")) * (TURN_RAD / (self.second_mm or 1.0))
        return np.cos(angle), np.sin(angle)

    def tables(self, values: np.ndarray) -> np.ndarray:
        """Return the periodic parts of mean, play and elastic [3, TABLE + 1] over one turn."""
        tables = np.zeros((3, TABLE_PHASES + 1))
        for row, kinds in enumerate((("mean", "ripple"), ("play",), ("elastic",))):
            spectrum = np.zeros(TABLE_PHASES // 2 + 1, complex)
            for kind in kinds:
                cos_mm, sin_mm = values[self.parts[f"{kind}_cos"]], values[self.parts[f"{kind}_sin"]]
                spectrum[self.waves(kind)] = cos_mm - 1j * sin_mm
            if spectrum.any():
                tables[row, :-1] = np.fft.irfft(spectrum, TABLE_PHASES) * (TABLE_PHASES / 2)
        tables[:, -1] = tables[:, 0]
        return tables


@lru_cache(maxsize=1024)
def _waves(design: Design, kind: str) -> np.ndarray:
    return frozen(np.array(design.ripple if kind == "ripple" else getattr(design, f"{kind}_harmonics"), np.int64))


@lru_cache(maxsize=256)
def _shared(mine: Design, theirs: Design) -> tuple[np.ndarray, np.ndarray]:
    """Return where the parameters that two designs share stand in the one [S] and in the other [S]."""
    pairs = []
    for name, part in mine.parts.items():
        place = {key: part.start + i for i, key in enumerate(mine._keys(name))}
        for i, key in enumerate(theirs._keys(name)):
            if key in place:
                pairs.append((place[key], theirs.parts[name].start + i))
    ours, others = np.array(pairs, np.int64).reshape(-1, 2).T
    return frozen(ours.copy()), frozen(others.copy())


def bed_middle(printer: Printer) -> np.ndarray:
    """Return the motors' positions [2] mm at the middle of the bed, from which the frame's terms are counted."""
    x, y = printer.x, printer.y
    return printer.to_motor(np.array([(x.min_mm + x.max_mm) / 2, (y.min_mm + y.max_mm) / 2]))
