"""The columns of the grey box and their normal equations.

With the last contact (row l, side s) of every row known, the model is linear: column values depend on the motor's
position at the contact through its phase φ and x = (m − origin)/100 mm, on s, and on the position of the other motor.
All harmonics are orthogonal trigonometric columns, so the products of any two follow from the weighted moments
T_j = Σ w e^{ijφ}: cos kφ cos lφ = (cos (k − l)φ + cos (k + l)φ)/2, and so on. The moments come from one pass over the
rows and a Fourier transform, whatever the number of harmonics; residuals, not positions, are fitted, so that the tiny
error of the binning vanishes as the fit converges.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from printmend.learn.drive.kernels import columns as kernels
from printmend.saved.branches import SCALE_MM, Branches, Wave, warp_columns
from printmend.units import TURN_RAD

CHUNK = 1 << 12  # rows whose columns stay in the cache
CELLS = 1024  # phases of the moments: products of two harmonics up to 32 are seen to 2 %, of residuals
WARP_TABLE = 2049
TABLE = 4096  # phases of the tables that the play is simulated with


@dataclass(frozen=True)
class Design:
    """Which columns there are.

    Order of parameters: where the belt was at the start (counted from the first measurement), mean powers, play
    powers, cross terms, cos and sin of the ripple, then cos and sin of the harmonics of mean, play and elastic.
    ``cross`` are the exponents (own, other) of the frame's terms, other ≥ 1; ``ripple`` the high harmonics of
    micro-step ripple; ``warp`` the number of cosines over ``warp_span_mm`` that make the part of the mean that repeats
    nothing (they come after the cross terms).
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

    @cached_property
    def parts(self) -> dict[str, slice]:
        """The place of every part in the parameter vector."""
        sizes = {
            "start": 1,
            "mean_powers": self.mean_powers,
            "play_powers": self.play_powers,
            "cross": len(self.cross),
            "warp": self.warp,
            "ripple_cos": len(self.ripple),
            "ripple_sin": len(self.ripple),
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
        """The number of columns that are not harmonics."""
        return 1 + self.mean_powers + self.play_powers + len(self.cross) + self.warp + 2 * len(self.ripple)

    @cached_property
    def harmonic(self) -> np.ndarray:
        """The harmonic of every parameter [P], 0 where it has none."""
        order = np.zeros(self.size, np.int64)
        for name, part in self.parts.items():
            if name.endswith(("_cos", "_sin")):
                order[part] = self.waves(name)
        return order

    def waves(self, name: str) -> np.ndarray:
        """Return the harmonics of ripple, mean, play or elastic (of ``mean_cos``, too)."""
        kind = name.removesuffix("_cos").removesuffix("_sin")
        return np.array(self.ripple if kind == "ripple" else getattr(self, f"{kind}_harmonics"), np.int64)

    def mask(self, *names: str) -> np.ndarray:
        """Mark the parameters [P] of the named parts; "mean" stands for mean_cos and mean_sin."""
        marked = np.zeros(self.size, bool)
        for name in names:
            for part in (name,) if name in self.parts else (f"{name}_cos", f"{name}_sin"):
                marked[self.parts[part]] = True
        return marked

    def moved(self, values: np.ndarray, other: "Design") -> np.ndarray:
        """Carry parameters of ``other`` over to this design; what is new is 0."""
        moved = np.zeros(self.size)
        for name, part in self.parts.items():
            mine = self._keys(name)
            for i, key in enumerate(other._keys(name)):
                if key in mine:
                    moved[part.start + mine.index(key)] = values[other.parts[name].start + i]
        return moved

    def _keys(self, name: str) -> list:
        if name in ("cross", "start"):
            return list(self.cross) if name == "cross" else [0]
        if name == "warp":
            return [(k, *self.warp_span_mm) for k in range(1, self.warp + 1)]
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
        )

    def columns(self, motor_mm: np.ndarray, period_mm: float, origin_mm: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns of mean and of play [N, P] at motor positions [N]; the frame's are 0 in both."""
        x = (motor_mm - origin_mm) / SCALE_MM
        phase = TURN_RAD * np.mod(motor_mm / period_mm, 1.0)[:, None]
        mean, play = np.zeros((len(x), self.size)), np.zeros((len(x), self.size))
        mean[:, self.parts["mean_powers"]] = x[:, None] ** np.arange(self.mean_powers)
        mean[:, self.parts["warp"]] = warp_columns(self.warp, self.warp_span_mm, motor_mm)
        play[:, self.parts["play_powers"]] = x[:, None] ** np.arange(self.play_powers)
        harmonics = np.unique(self.harmonic[self.harmonic > 0])
        turned = {"cos": np.cos(phase * harmonics), "sin": np.sin(phase * harmonics)}
        for name, part in self.parts.items():
            if name.endswith(("_cos", "_sin")):
                wave = turned[name[-3:]][:, np.searchsorted(harmonics, self.waves(name))]
                into = play if name.startswith("play") else mean
                into[:, part] = wave * x[:, None] if name.startswith("elastic") else wave
        return mean, play

    def tables(self, values: np.ndarray) -> np.ndarray:
        """Return the periodic parts of mean, play and elastic [3, TABLE + 1] over one turn."""
        tables = np.zeros((3, TABLE + 1))
        for row, kinds in enumerate((("mean", "ripple"), ("play",), ("elastic",))):
            spectrum = np.zeros(TABLE // 2 + 1, complex)
            for kind in kinds:
                cos_mm, sin_mm = values[self.parts[f"{kind}_cos"]], values[self.parts[f"{kind}_sin"]]
                spectrum[self.waves(kind)] = cos_mm - 1j * sin_mm
            if spectrum.any():
                tables[row, :-1] = np.fft.irfft(spectrum, TABLE) * (TABLE / 2)
        tables[:, -1] = tables[:, 0]
        return tables


def warp_table(cos_mm: np.ndarray) -> np.ndarray:
    """Return Σ_k c_k cos(πk t) at 2049 even places t of its span [0, 1]; nothing where there are no cosines."""
    if not len(cos_mm):
        return np.zeros(0)
    last = WARP_TABLE - 1
    spectrum = np.zeros(WARP_TABLE)
    spectrum[1 : 1 + len(cos_mm)] = last * cos_mm
    return np.fft.irfft(spectrum, 2 * last)[:WARP_TABLE]


@dataclass(frozen=True, eq=False)
class Rows:
    """One motor's side of a trace, as the fit sees it. ``middle_mm`` is the bed's middle (own, other).

    ``motor_mm`` [N]; ``measured_mm`` [N], NaN where nothing was measured; ``weight`` [N] relative, 0 where NaN;
    ``own_mm`` and ``other_mm`` [N] are where the belts are along this motor and the other, counted from the bed's
    middle: the frame's terms act on them. ``start_mm`` is where the belt is thought to be at row 0.
    """

    motor_mm: np.ndarray
    measured_mm: np.ndarray
    weight: np.ndarray
    own_mm: np.ndarray
    other_mm: np.ndarray
    period_mm: float
    origin_mm: float
    start_mm: float
    middle_mm: tuple[float, float]

    def __len__(self) -> int:
        return len(self.motor_mm)

    @property
    def reach_mm(self) -> tuple[float, float]:
        return float(self.motor_mm.min()), float(self.motor_mm.max())

    def subset(self, keep: np.ndarray, use: np.ndarray) -> "Rows":
        """Return the rows ``keep`` [N], of which only those in ``use`` [N] count as measured."""
        return replace(
            self,
            motor_mm=self.motor_mm[keep],
            measured_mm=np.where(use, self.measured_mm, np.nan)[keep],
            weight=np.where(use, self.weight, 0.0)[keep],
            own_mm=self.own_mm[keep],
            other_mm=self.other_mm[keep],
        )


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where a model puts the belt: per row the last contact (−1 before the first), its side (0 before the first), the
    belt's place, and the residual (NaN where nothing was measured)."""

    at: np.ndarray
    side: np.ndarray
    belt_mm: np.ndarray
    residual_mm: np.ndarray


def cross_columns(design: Design, rows: Rows, part: slice | np.ndarray) -> np.ndarray:
    """Return the frame's columns [M, C] of some rows."""
    own, other = rows.own_mm[part] / SCALE_MM, rows.other_mm[part] / SCALE_MM
    if not design.cross:
        return np.zeros((len(own), 0))
    return np.stack([own**p * other**q for p, q in design.cross], axis=1)


def contacts(design: Design, values: np.ndarray, rows: Rows) -> Contacts:
    """Simulate the play with parameters [P]."""
    at, side = np.empty(len(rows), np.int64), np.empty(len(rows), np.int8)
    belt = np.empty(len(rows))
    part = {name: values[place] for name, place in design.parts.items()}
    kernels.follow_play(
        rows.motor_mm,
        rows.origin_mm,
        rows.period_mm,
        design.tables(values),
        part["mean_powers"],
        part["play_powers"],
        warp_table(part["warp"]),
        np.array(design.warp_span_mm),
        rows.start_mm + part["start"][0],
        at,
        side,
        belt,
    )
    residual = rows.measured_mm - belt
    if part["cross"].any():
        for first in range(0, len(rows), CHUNK):
            chunk = slice(first, first + CHUNK)
            residual[chunk] -= cross_columns(design, rows, chunk) @ part["cross"]
    return Contacts(at, side, belt, residual)


@dataclass(frozen=True, eq=False)
class Normal:
    """Weighted normal equations about the parameters ``values`` [P]: ``matrix`` = ΦᵀWΦ [P, P], ``slope`` = ΦᵀWr [P] and
    ``square`` = rᵀWr, over ``count`` rows."""

    values: np.ndarray
    matrix: np.ndarray
    slope: np.ndarray
    square: float
    count: float

    def tempered(self, share: float) -> "Normal":
        """Return the equations as if only a ``share`` of the rows were independent."""
        return Normal(self.values, share * self.matrix, share * self.slope, share * self.square, share * self.count)


def normal_equations(design: Design, values: np.ndarray, rows: Rows, touch: Contacts, weight: np.ndarray) -> Normal:
    """Assemble the normal equations of all columns for weights [N], by moments over the phase."""
    extra = design.extras + 1
    # only an elastic belt needs the powers of x
    powers, crossed = (3, 2) if design.elastic_harmonics else (1, 1)
    bins, cross, gram = np.zeros((2, powers, CELLS)), np.zeros((2, crossed, CELLS, extra)), np.zeros((extra, extra))
    _bin_start(design, rows, touch, weight, gram)
    used, root = np.flatnonzero((weight > 0) & (touch.at >= 0)), np.sqrt(weight)
    own_powers, other_powers = np.array(design.cross, np.int64).reshape(-1, 2).T.copy()
    for first in range(0, len(used), CHUNK):
        row = used[first : first + CHUNK]
        contact = row, touch.at, touch.side, root, rows.motor_mm
        columns = np.empty((len(row), extra))
        kernels.plain_columns(
            *contact, rows.own_mm, rows.other_mm, touch.residual_mm, rows.origin_mm, rows.period_mm,
            design.mean_powers, design.play_powers, own_powers, other_powers,
            design.warp, np.array(design.warp_span_mm), design.waves("ripple"), columns,
        )  # fmt: skip
        gram += columns.T @ columns
        kernels.bin_moments(*contact, rows.origin_mm, rows.period_mm, columns, bins, cross)
    matrix, slope = _assemble(design, bins, cross, gram)
    return Normal(values, matrix, slope, float(gram[-1, -1]), int((weight > 0).sum()))


def _bin_start(design: Design, rows: Rows, touch: Contacts, weight: np.ndarray, gram: np.ndarray) -> None:
    """Add the rows before the first contact: the belt is where it started, and only the frame moves the carriage."""
    row = np.flatnonzero((weight > 0) & (touch.at < 0))
    columns = np.zeros((len(row), design.extras + 1))
    columns[:, 0] = 1.0
    columns[:, design.parts["cross"]] = cross_columns(design, rows, row)
    columns[:, -1] = touch.residual_mm[row]
    gram += (columns * weight[row, None]).T @ columns


def _assemble(design: Design, bins: np.ndarray, cross: np.ndarray, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    plain, count = design.extras, design.size
    full = np.zeros((count + 1, count + 1))  # the residual is one more column, the last
    place = np.append(np.arange(plain), count)
    full[np.ix_(place, place)] = gram
    # Σ w xᵖ e^{ijφ} by side; a play column carries s/2, so products need the sum, half the difference and a quarter.
    trig = np.conj(np.fft.rfft(bins, axis=-1))
    trig_cross = np.conj(np.fft.rfft(np.moveaxis(cross, -2, -1), axis=-1))
    blocks = {"mean": (0, 0), "play": (1, 0), "elastic": (0, 1)}  # powers of s/2 and of x
    names = [name for name in blocks if len(design.waves(name))]
    for i, name in enumerate(names):
        sides, power = blocks[name]
        k = design.waves(name)
        moments = _sided(trig_cross[:, power], sides)[:, k]
        for part, values in ((f"{name}_cos", moments.real), (f"{name}_sin", moments.imag)):
            full[place, design.parts[part]] = values
            full[design.parts[part], place] = values.T
        for other in names[: i + 1]:
            j = design.waves(other)
            both = _sided(trig[:, power + blocks[other][1]], sides + blocks[other][0])
            up = both[k[:, None] + j]
            away = k[:, None] - j
            down = both[np.abs(away)]
            down = np.where(away < 0, np.conj(down), down)
            products = {
                ("cos", "cos"): (down.real + up.real) / 2,
                ("sin", "sin"): (down.real - up.real) / 2,
                ("cos", "sin"): (up.imag - down.imag) / 2,
                ("sin", "cos"): (up.imag + down.imag) / 2,
            }
            for (mine, theirs), values in products.items():
                at = design.parts[f"{name}_{mine}"], design.parts[f"{other}_{theirs}"]
                full[at[0], at[1]] = values
                full[at[1], at[0]] = values.T
    return full[:count, :count], full[:count, count]


def _sided(moments: np.ndarray, power: int) -> np.ndarray:
    """Combine the moments of the lower [0] and upper [1] side for columns that carry (s/2)^power."""
    lower, upper = (-0.5) ** power, 0.5**power
    return lower * moments[0] + upper * moments[1]
