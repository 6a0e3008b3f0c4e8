"""The columns of the grey box and their normal equations.

With the last contact (row l, side s) of every row known, the model is linear: column values depend on the motor's
position at the contact through its phase φ and x = (m − origin)/100 mm, on s, and on the position of the other motor.
The sums of products of any two harmonics follow from the weighted moments T_j = Σ w e^{ijφ}, because cos kφ cos lφ =
(cos (k − l)φ + cos (k + l)φ)/2, and so on. The moments come from one pass over the rows, which bins them by phase, and
a Fourier transform, whatever the number of harmonics. Residuals are fitted, not positions, so that the small error of
the binning vanishes as the fit converges.
"""

from dataclasses import dataclass, replace

import numpy as np

from printmend.model import SCALE_MM
from printmend_lab.greybox.drive import kernels
from printmend_lab.greybox.layout import Design

CHUNK_ROWS = 1 << 12  # rows that are summed at once: their columns stay in the processor's cache
PHASE_CELLS = 1024  # cells of a turn for the moments: of two harmonics up to 32 their product is off by 2 % at most
WARP_PLACES = 2049  # places at which the part that repeats nothing is tabulated


def warp_table(cos_mm: np.ndarray) -> np.ndarray:
    """Return Σ_k c_k cos(πk t) at `WARP_PLACES` even places t of [0, 1]; an empty array where there are no cosines."""
    if not len(cos_mm):
        return np.zeros(0)
    last = WARP_PLACES - 1
    spectrum = np.zeros(WARP_PLACES)
    spectrum[1 : 1 + len(cos_mm)] = last * cos_mm
    return np.fft.irfft(spectrum, 2 * last)[:WARP_PLACES]


def _along(design: Design, part: dict[str, np.ndarray]) -> np.ndarray:
    """Return what follows no turn of the motor at `WARP_PLACES` even places of the warp's span; empty for nothing."""
    table = warp_table(part["warp"])
    if not len(part["second_cos"]):
        return table
    cosines, sines = design.second_columns(np.linspace(*design.warp_span_mm, WARP_PLACES))
    wave = cosines @ part["second_cos"] + sines @ part["second_sin"]
    return table + wave if len(table) else wave


@dataclass(frozen=True, eq=False)
class Rows:
    """One motor's side of a trace, as the fit sees it.

    ``motor_mm`` [N] are the commanded positions, ``measured_mm`` [N] the measured ones of its belt, NaN where there is
    none, and ``weight`` [N] their relative weights, 0 where NaN. ``own_mm`` and ``other_mm`` [N] are where the belts of
    this motor and of the other are, counted from the bed's middle ``middle_mm`` (own, other): the frame's terms depend
    on them. ``start_mm`` is where the belt is thought to be at row 0, ``period_mm`` the motor's turn, and the powers
    count from ``origin_mm``. At most the share ``independent`` of the rows tell something of their own.
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
    independent: float = 1.0

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
    """Where a model puts the belt, row by row.

    ``at`` [N] is the row of the last contact (−1 before the first), ``side`` [N] its branch (0 before the first),
    ``belt_mm`` [N] the belt's place and ``residual_mm`` [N] what was measured beyond it, NaN where nothing was.
    """

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
    """Follow the rows through the play of a drive with the parameters ``values`` [P]; return its contacts."""
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
        _along(design, part),
        np.array(design.warp_span_mm),
        rows.start_mm + part["start"][0],
        at,
        side,
        belt,
    )
    residual = rows.measured_mm - belt
    if part["cross"].any():
        for first in range(0, len(rows), CHUNK_ROWS):
            chunk = slice(first, first + CHUNK_ROWS)
            residual[chunk] -= cross_columns(design, rows, chunk) @ part["cross"]
    return Contacts(at, side, belt, residual)


@dataclass(frozen=True, eq=False)
class Normal:
    """Weighted normal equations about the parameters ``values`` [P], at which the residuals are r.

    ``matrix`` = ΦᵀWΦ [P, P], ``slope`` = ΦᵀWr [P], ``square`` = rᵀWr, over ``count`` rows.
    """

    values: np.ndarray
    matrix: np.ndarray
    slope: np.ndarray
    square: float
    count: float

    def tempered(self, share: float) -> "Normal":
        """Return the equations as if only a ``share`` of the rows were independent."""
        return Normal(self.values, share * self.matrix, share * self.slope, share * self.square, share * self.count)


def normal_equations(design: Design, values: np.ndarray, rows: Rows, touch: Contacts, weight: np.ndarray) -> Normal:
    """Assemble the normal equations of all columns for rows with weights [N], from their moments over the phase."""
    extra = design.extras + 1
    # only an elastic belt needs the powers of x
    powers, crossed = (3, 2) if design.elastic_harmonics else (1, 1)
    bins, cross, gram = (
        np.zeros((2, powers, PHASE_CELLS)),
        np.zeros((2, crossed, PHASE_CELLS, extra)),
        np.zeros((extra, extra)),
    )
    _bin_start(design, rows, touch, weight, gram)
    used, root = np.flatnonzero((weight > 0) & (touch.at >= 0)), np.sqrt(weight)
    own_powers, other_powers = np.array(design.cross, np.int64).reshape(-1, 2).T.copy()
    for first in range(0, len(used), CHUNK_ROWS):
        row = used[first : first + CHUNK_ROWS]
        contact = row, touch.at, touch.side, root, rows.motor_mm
        columns = np.empty((len(row), extra))
        kernels.plain_columns(
            *contact, rows.own_mm, rows.other_mm, touch.residual_mm, rows.origin_mm, rows.period_mm,
            design.mean_powers, design.play_powers, own_powers, other_powers,
            design.warp, np.array(design.warp_span_mm), design.waves("ripple"), columns,
        )  # fmt: skip
        cosines, sines = design.second_columns(rows.motor_mm[touch.at[row]])
        for name, waves in (("second_cos", cosines), ("second_sin", sines)):
            columns[:, design.parts[name]] = root[row, None] * waves
        gram += columns.T @ columns
        kernels.bin_moments(*contact, rows.origin_mm, rows.period_mm, columns, bins, cross)
    matrix, slope = _assemble(design, bins, cross, gram)
    return Normal(values, matrix, slope, float(gram[-1, -1]), int((weight > 0).sum()))


def _bin_start(design: Design, rows: Rows, touch: Contacts, weight: np.ndarray, gram: np.ndarray) -> None:
    """Add the rows before the first contact to ``gram``: the belt is where it started; only the frame moves the
    carriage.
    """
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
            at = [*design.wave_at(name, 0), *design.wave_at(other, 0)]
            kernels.put_products(both, k, j, *at, full)
    return full[:count, :count], full[:count, count]


def _sided(moments: np.ndarray, power: int) -> np.ndarray:
    """Combine the moments of the lower [0] and upper [1] side for columns that carry (s/2)^power."""
    lower, upper = (-0.5) ** power, 0.5**power
    return lower * moments[0] + upper * moments[1]
