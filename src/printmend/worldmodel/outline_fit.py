"""Fit outlines to what a motor's rows say, and weigh them by their evidence.

At the angle θ the belt is at m + r₀ (U(θ; q) − θ) + Σ l (columns · nuisance), U from `outline`. The places of a lattice
are visited many times: their means are fitted. What scatters at one place is noise; what the means leave is a second
variance, estimated for each outline: next to nothing for the true one where the print has no noise, and then all of q
is known, seen or not. The evidence is Laplace's, every prior proper.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from printmend.worldmodel.outline import Outline, Series

FLOOR_MM = 1e-7  # nothing is simulated or written more finely
FIRST_MM = 0.05
STEPS = 12
LOOKS, LOOK_MM = 2, 0.005  # steps of the first look, before all but the best starts are left, and its σ
KEPT = 3
ROUNDS = 8  # of what is left at a place
SAME = 0.05


@dataclass(frozen=True, eq=False)
class Places:
    """What was measured: G means. ``angle_rad`` [G] is where the outline unwinds, ``error_mm`` [G] the belt less
    ``motor_mm`` [G], ``side`` [G] the branch (±1, 0 without play), ``columns`` [G, L] what is no pulley, of the sizes
    ``spread`` [L]; ``rows`` [G] are behind each mean, the ``noise_mm`` of one 0 where no place was visited twice."""

    radius_mm: float
    motor_mm: np.ndarray
    angle_rad: np.ndarray
    side: np.ndarray
    error_mm: np.ndarray
    columns: np.ndarray
    spread: np.ndarray
    rows: np.ndarray
    noise_mm: float

    def __len__(self) -> int:
        return len(self.angle_rad)


@dataclass(frozen=True, eq=False)
class Fitted:
    """An outline at its best parameters ``q`` [P] and nuisance ``rest`` [L]; their ``covariance`` [P + L, P + L], the
    standard deviation ``left_mm`` of what is left at a place, the residuals [G], and the log evidence."""

    outline: Outline
    q: np.ndarray
    rest: np.ndarray
    covariance: np.ndarray
    left_mm: float
    residual_mm: np.ndarray
    log_evidence: float


def fitted(outline: Outline, places: Places) -> Fitted:
    """Return the best fit from the outline's starts."""
    starts = list(outline.starts())
    if len(starts) > 1:
        problem = _Problem(outline, places, LOOK_MM**2)
        looked = [problem.improved(q, LOOKS) for q in starts]
        order = np.argsort([problem.cost(q) for q in looked])
        starts = sorted((problem.improved(looked[i], STEPS) for i in order[:KEPT]), key=problem.cost)
    return _settled(outline, places, starts[0])


def _settled(outline: Outline, places: Places, q: np.ndarray) -> Fitted:
    """Fit from near, what is left at a place being estimated along the way."""
    variance, noise = FIRST_MM**2, places.noise_mm**2 / places.rows
    for _ in range(ROUNDS):
        problem = _Problem(outline, places, variance)
        q = problem.solved(q).q if isinstance(outline, Series) else problem.improved(q, STEPS)
        solution = problem.solved(q)
        after = max(float((solution.residual_mm**2).sum() / solution.spare - noise.mean()), FLOOR_MM**2)
        if abs(np.log(after / variance)) < SAME:
            break
        variance = after
    factor = solution.factor
    whole = variance + noise
    evidence = (solution.residual_mm**2 / whole).sum() + np.log(whole).sum() + problem.away(q, solution.rest)
    evidence += 2 * np.log(np.abs(np.diag(factor))).sum() + 2 * np.log(problem.spread).sum()
    fine = solve_triangular(factor, np.eye(len(factor)))
    return Fitted(
        outline, q, solution.rest, fine @ fine.T, float(np.sqrt(variance)), solution.residual_mm, -0.5 * float(evidence)
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    """The linear solution about some q: ``q`` [P] after a whole step, ``rest`` [L], the triangular ``factor`` of the
    posterior's precision, the residuals [G] at the old q, and how many of them nothing was spent on."""

    q: np.ndarray
    rest: np.ndarray
    factor: np.ndarray
    residual_mm: np.ndarray
    spare: float


class _Problem:
    """An outline, places, and the variance of what is left at them."""

    def __init__(self, outline: Outline, places: Places, variance: float) -> None:
        self.outline, self.places = outline, places
        self.root = 1 / np.sqrt(variance + places.noise_mm**2 / places.rows)
        self.spread = np.concatenate([outline.spread, places.spread])
        self.basis = np.linalg.qr(places.columns * self.root[:, None])[0]

    def away(self, q: np.ndarray, rest: np.ndarray) -> float:
        """Return the square of the parameters' distance from what is usual."""
        usual = np.nan_to_num((q - self.outline.centre) / self.outline.spread)
        return float((usual**2).sum() + ((rest / self.places.spread) ** 2).sum())

    def cost(self, q: np.ndarray) -> float:
        """Return the misfit [σ²] at q with the best nuisance parameters."""
        unwound = self.outline.unwound(q, self.places.angle_rad)[0]
        left = self.root * (self.places.error_mm - self.places.radius_mm * unwound)
        left -= self.basis @ (self.basis.T @ left)
        return float((left**2).sum()) + self.away(q, np.zeros(len(self.places.spread)))

    def solved(self, q: np.ndarray) -> _Solution:
        value, slope = self.outline.unwound(q, self.places.angle_rad)
        radius, columns = self.places.radius_mm, self.places.columns
        design = np.concatenate([radius * slope, columns], axis=1)
        error = self.places.error_mm - radius * value
        target = error + radius * (slope @ q)
        usual = np.where(np.isnan(self.outline.centre), q, self.outline.centre)
        stacked = np.concatenate([design * self.root[:, None], np.diag(1 / self.spread)])
        wanted = np.concatenate([target * self.root, usual / self.outline.spread, np.zeros(len(self.places.spread))])
        basis, factor = np.linalg.qr(stacked)
        found = solve_triangular(factor, basis.T @ wanted)
        rest = np.linalg.lstsq(columns * self.root[:, None], error * self.root, rcond=None)[0]
        known = (basis[: len(self.root)] ** 2).sum()
        return _Solution(found[: len(q)], rest, factor, error - columns @ rest, max(float(len(self.root) - known), 1.0))

    def improved(self, q: np.ndarray, steps: int) -> np.ndarray:
        """Return q after so many Gauss–Newton steps, each shortened until it helps."""
        cost = self.cost(q)
        for _ in range(steps):
            step = self.solved(q).q - q
            for length in (1.0, 0.3, 0.1, 0.03):
                now = self.cost(q + length * step)
                if now < cost:
                    break
            else:
                break
            gained, q, cost = cost - now, q + length * step, now
            if gained < 1e-3:
                break
        return q
