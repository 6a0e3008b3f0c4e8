"""Scatter that no effect explains: how much of it, and of the outliers, is the printer's."""

import math
from dataclasses import dataclass

import numpy as np

from printmend.effects.prior import number_of, share_of, size_mm

_SIZES_MM = 0.001 * np.arange(1, 300)  # of scatter that are weighed


@dataclass(frozen=True)
class Scatter:
    """By how much the mean square of marks' coordinates exceeds what their instrument says, ``square_mm2``, by chance
    below 0, and its standard deviation ``sd_mm2``, 0 where it is taken as it is."""

    square_mm2: float = 0.0
    sd_mm2: float = 0.0

    @classmethod
    def of(cls, variance_mm2: float, free: float, own_mm: float | None) -> "Scatter":
        """Return the scatter of marks whose coordinates have this variance, from so many ``free`` numbers, with an
        instrument that scatters by ``own_mm``: none where it does not say. The variance of normal noise from n numbers
        has a relative deviation of √(2/n)."""
        if own_mm is None:
            return cls()
        return cls(variance_mm2 - own_mm**2, variance_mm2 * (2 / free) ** 0.5)

    def quantiles_mm2(self, chance: np.ndarray) -> np.ndarray:
        """Return the quantiles at each ``chance`` [D] of the printer's variance: some printers have none, others one of
        a half-normal size, and each is as likely as it makes what was seen."""
        if not self.sd_mm2:
            return np.full(len(chance), max(self.square_mm2, 0.0))
        share, sd_mm = share_of("scatter"), size_mm("scatter")
        prior = np.exp(-0.5 * (_SIZES_MM / sd_mm) ** 2)
        sizes_mm2 = np.concatenate([[0.0], _SIZES_MM**2])
        log_weight = np.log(np.concatenate([[1.0 - share], share * prior / prior.sum()]))
        log_weight -= 0.5 * ((self.square_mm2 - sizes_mm2) / self.sd_mm2) ** 2
        weight = np.cumsum(np.exp(log_weight - log_weight.max()))
        return sizes_mm2[np.searchsorted(weight / weight[-1], chance)]


@dataclass(frozen=True)
class Outliers:
    """Marks that fit no model and that the printer may have made: their expected number, rounded; the number of all
    marks ``measured``; the mean square error of their coordinates [mm²]."""

    count: int = 0
    measured: int = 0
    square_mm2: float = 0.0

    @classmethod
    def of(cls, left_mm: np.ndarray, measured: int) -> "Outliers":
        """Return what errors [K, 2] of marks say. Each mark is weighted by the probability that the printer, not a
        wrong cell or mark, made an error of its size."""
        dirt_mm, own_mm = number_of("outliers", "dirt_mm"), number_of("outliers", "own_mm")
        off_mm = np.hypot(*left_mm.T)
        weight = 1 / (1 + own_mm / dirt_mm * np.exp(np.minimum(off_mm / own_mm - off_mm / dirt_mm, 500.0)))
        count = round(float(weight.sum()))
        return cls(count, measured, float(np.average(np.mean(left_mm**2, axis=1), weights=weight))) if count else cls()

    def drawn_mm2(self, draws: int, rng: np.random.Generator) -> np.ndarray:
        """Draw the mean square that such errors add to a coordinate of the print [draws]: nothing where an instrument
        makes them all, else by the share of marks that are the printer's.

        Both shares are exponential, so the count follows a geometric law, or the sum of two.
        """
        if not self.count:
            return np.zeros(draws)
        dirt, own, prior = (number_of("outliers", key) for key in ("dirt", "own", "share"))
        log_a, log_b = (-math.log1p(1 / (self.measured * each)) for each in (dirt, own))
        order = self.count + 1
        log_both = (
            log_b * order + math.log(-math.expm1((log_a - log_b) * order)) - math.log(math.exp(log_b) - math.exp(log_a))
        )
        odds = prior / (1 - prior) * math.exp(min(log_both + math.log(-math.expm1(log_b)) - log_a * self.count, 500.0))
        all_of_them, rate = self.count / self.measured, 1 / dirt - 1 / own
        of_dirt = -np.log1p(rng.uniform(size=draws) * math.expm1(-rate * all_of_them)) / rate  # exponential, cut there
        is_printers = rng.uniform(size=draws) < odds / (1 + odds)
        return np.asarray(is_printers * (all_of_them - of_dirt) * self.square_mm2)


NO_SCATTER, NO_OUTLIERS = Scatter(), Outliers()
