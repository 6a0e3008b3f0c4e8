"""Fit outlines to what a motor's rows say, and weigh them by their evidence.

At the angle θ the belt is at m + r₀ (U(θ; q) − θ) + Σ l (columns · nuisance), U from `outline`. The places of a lattice
are visited many times: their means are fitted. What scatters at one place is noise; what the means leave is a second
variance, estimated for each outline: next to nothing for the true one where the print has no noise, and then all of q
is known, seen or not. The evidence is Laplace's, every prior proper.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dgeqrf, dtrtrs

from printmend.learn.pulley.outline import Outline, Series

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
        q = problem.stepped(q) if isinstance(outline, Series) else problem.improved(q, STEPS)
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
    """The linear solution about some q: ``rest`` [L], the triangular ``factor`` of the posterior's precision, the
    residuals [G], and how many of them nothing was spent on."""

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
        known = ~np.isnan(outline.centre)
        self.known, self.centre = known / outline.spread, np.where(known, outline.centre, 0.0)
        self.last: tuple[bytes, np.ndarray, np.ndarray] = b"", np.zeros(0), np.zeros(0)

    def away(self, q: np.ndarray, rest: np.ndarray) -> float:
        """Return the square of the parameters' distance from what is usual."""
        return self._unusual(q) + float(((rest / self.places.spread) ** 2).sum())

    def _unusual(self, q: np.ndarray) -> float:
        usual = (q - self.centre) * self.known
        return float(usual @ usual)

    def _unwound(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = q.tobytes()  # a cost is often followed by a step from there
        if key != self.last[0]:
            self.last = key, *self.outline.unwound(q, self.places.angle_rad)
        return self.last[1:]

    def cost(self, q: np.ndarray) -> float:
        """Return the misfit [σ²] at q with the best nuisance parameters."""
        left = self.root * (self.places.error_mm - self.places.radius_mm * self._unwound(q)[0])
        left -= self.basis @ (self.basis.T @ left)
        return float(left @ left) + self._unusual(q)

    def _stacked(self, q: np.ndarray) -> np.ndarray:
        """Return the weighted equations for (q, rest) [G + P + L, P + L + 1] about some q, the wanted values last."""
        value, slope = self._unwound(q)
        places, count = self.places, len(self.root)
        stacked = np.zeros((count + len(self.spread), len(self.spread) + 1), order="F")
        stacked[:count, : len(q)] = places.radius_mm * slope
        stacked[:count, len(q) : -1] = places.columns
        stacked[:count, -1] = places.error_mm - places.radius_mm * (value - slope @ q)
        stacked[:count] *= self.root[:, None]
        stacked[range(count, len(stacked)), range(len(self.spread))] = 1 / self.spread
        stacked[count : count + len(q), -1] = np.where(self.known > 0, self.centre, q) / self.outline.spread
        return stacked

    def stepped(self, q: np.ndarray) -> np.ndarray:
        """Return q after a whole Gauss–Newton step."""
        packed, size = dgeqrf(self._stacked(q))[0], len(self.spread)  # the last column becomes what it is in the basis
        return np.asarray(dtrtrs(packed[:size, :size], packed[:size, size])[0][: len(q)])

    def solved(self, q: np.ndarray) -> _Solution:
        stacked, places = self._stacked(q), self.places
        basis, factor = np.linalg.qr(stacked[:, :-1])
        error = places.error_mm - places.radius_mm * self._unwound(q)[0]
        rest = np.linalg.lstsq(places.columns * self.root[:, None], error * self.root, rcond=None)[0]
        known = (basis[: len(self.root)] ** 2).sum()
        return _Solution(rest, factor, error - places.columns @ rest, max(float(len(self.root) - known), 1.0))

    def improved(self, q: np.ndarray, steps: int) -> np.ndarray:
        """Return q after so many Gauss–Newton steps, each shortened until it helps."""
        cost = self.cost(q)
        for _ in range(steps):
            step = self.stepped(q) - q
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
