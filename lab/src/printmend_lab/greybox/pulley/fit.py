"""Fit outlines to a motor's measured places, and weigh them by their evidence.

At the motor's angle θ the belt is at m + r₀ (U(θ; q) − θ) + Σ columns · nuisance, with U of `outline`. A print on a
lattice visits each place many times, and the means of the places are fitted. The scatter at one place is noise. What
an outline leaves of the means is a second variance, estimated for each outline: for the true one it is next to zero
where the print has no noise, and then all of q is known, whether it was seen or not. The evidence is Laplace's
(physics.md eq. 20), with proper priors.
"""

from dataclasses import dataclass

import numpy as np

from printmend_lab.greybox.pulley.outline import Outline, SeriesOutline

LEAST_LEFT_MM = 1e-7  # smallest standard deviation of what an outline leaves: tables are not written more finely
FIRST_LEFT_MM = 0.05  # first guess of that standard deviation, the noise of an ordinary scan
NEWTON_STEPS = 12  # most Gauss–Newton steps from a start; three to six are usual
FIRST_LOOK_STEPS = 2  # steps from every start before the best of them are chosen
FIRST_LOOK_LEFT_MM = 0.005  # standard deviation of what is left that the first look assumes
KEPT_STARTS = 3  # starts that are followed to the end
MOST_VARIANCE_ROUNDS = 8  # most updates of the variance that is left
SAME_VARIANCE_LOG = 0.05  # a smaller change of that variance's logarithm ends the updates


@dataclass(frozen=True, eq=False)
class MotorPlaces:
    """The measured places of one motor, G of them, each the mean of its rows.

    ``angle_rad`` [G] is the angle from which the outline has unwound, ``error_mm`` [G] how far the belt is ahead of
    ``motor_mm`` [G], and ``side`` [G] the branch (±1; 0 without play). ``columns`` [G, L] are those of the nuisance
    parameters, offset and play, with prior standard deviations ``spread`` [L] mm. ``rows`` [G] counts the rows behind
    each mean; ``noise_mm`` is the standard deviation of one row, 0 where no place was visited twice.
    """

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
class OutlineFit:
    """An outline with its best parameters ``q`` [P] and nuisance parameters ``rest`` [L].

    ``covariance`` [P + L, P + L] is theirs, ``left_mm`` the standard deviation of what the outline leaves at a place,
    ``residual_mm`` [G] what it leaves there.
    """

    outline: Outline
    q: np.ndarray
    rest: np.ndarray
    covariance: np.ndarray
    left_mm: float
    residual_mm: np.ndarray
    log_evidence: float


def fitted_outline(outline: Outline, places: MotorPlaces) -> OutlineFit:
    """Fit an outline from each of its starts; return the best fit."""
    starts = list(outline.starts())
    if len(starts) > 1:
        problem = _Problem(outline, places, FIRST_LOOK_LEFT_MM**2)
        looked = [problem.improved(q, FIRST_LOOK_STEPS) for q in starts]
        order = np.argsort([problem.cost(q) for q in looked])
        starts = sorted((problem.improved(looked[i], NEWTON_STEPS) for i in order[:KEPT_STARTS]), key=problem.cost)
    return _with_variance(outline, places, starts[0])


def _with_variance(outline: Outline, places: MotorPlaces, q: np.ndarray) -> OutlineFit:
    """Fit an outline from parameters near the best, in turn with the variance of what it leaves at a place."""
    variance, noise = FIRST_LEFT_MM**2, places.noise_mm**2 / places.rows
    for _ in range(MOST_VARIANCE_ROUNDS):
        problem = _Problem(outline, places, variance)
        q = problem.stepped(q) if isinstance(outline, SeriesOutline) else problem.improved(q, NEWTON_STEPS)
        solution = problem.solved(q)
        after = max(float((solution.residual_mm**2).sum() / solution.spare - noise.mean()), LEAST_LEFT_MM**2)
        if abs(np.log(after / variance)) < SAME_VARIANCE_LOG:
            break
        variance = after
    factor = solution.factor
    whole = variance + noise
    evidence = (solution.residual_mm**2 / whole).sum() + np.log(whole).sum() + problem.away(q, solution.rest)
    evidence += 2 * np.log(np.abs(np.diag(factor))).sum() + 2 * np.log(problem.spread).sum()
    fine = np.linalg.inv(factor)
    return OutlineFit(
        outline, q, solution.rest, fine @ fine.T, float(np.sqrt(variance)), solution.residual_mm, -0.5 * float(evidence)
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    """The least-squares solution of the equations linearised about some q.

    ``rest`` [L] are the nuisance parameters, ``factor`` [P + L, P + L] the triangular factor of the posterior's
    precision, ``residual_mm`` [G] the residuals and ``spare`` their degrees of freedom.
    """

    rest: np.ndarray
    factor: np.ndarray
    residual_mm: np.ndarray
    spare: float


class _Problem:
    """An outline to fit to places, with a given variance [mm²] of what it leaves at them."""

    def __init__(self, outline: Outline, places: MotorPlaces, variance: float) -> None:
        self.outline, self.places = outline, places
        self.root = 1 / np.sqrt(variance + places.noise_mm**2 / places.rows)
        self.spread = np.concatenate([outline.spread, places.spread])
        self.basis = np.linalg.qr(places.columns * self.root[:, None])[0]
        known = ~np.isnan(outline.centre)
        self.known, self.centre = known / outline.spread, np.where(known, outline.centre, 0.0)
        self.last: tuple[bytes, np.ndarray, np.ndarray] = b"", np.zeros(0), np.zeros(0)

    def away(self, q: np.ndarray, rest: np.ndarray) -> float:
        """Return the squared distance of the parameters from the prior's mean, in its standard deviations."""
        return self._unusual(q) + float(((rest / self.places.spread) ** 2).sum())

    def _unusual(self, q: np.ndarray) -> float:
        usual = (q - self.centre) * self.known
        return float(usual @ usual)

    def _unwound(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = q.tobytes()  # a cost is often followed by a step from the same q
        if key != self.last[0]:
            self.last = key, *self.outline.unwound(q, self.places.angle_rad)
        return self.last[1:]

    def cost(self, q: np.ndarray) -> float:
        """Return the misfit [σ²] of q, its distance from the prior included, with the best nuisance parameters."""
        left = self.root * (self.places.error_mm - self.places.radius_mm * self._unwound(q)[0])
        left -= self.basis @ (self.basis.T @ left)
        return float(left @ left) + self._unusual(q)

    def _stacked(self, q: np.ndarray) -> np.ndarray:
        """Return the weighted equations for (q, rest), linearised about q: [G + P + L, P + L + 1], right side last."""
        value, slope = self._unwound(q)
        places, count = self.places, len(self.root)
        stacked = np.zeros((count + len(self.spread), len(self.spread) + 1))
        stacked[:count, : len(q)] = places.radius_mm * slope
        stacked[:count, len(q) : -1] = places.columns
        stacked[:count, -1] = places.error_mm - places.radius_mm * (value - slope @ q)
        stacked[:count] *= self.root[:, None]
        stacked[range(count, len(stacked)), range(len(self.spread))] = 1 / self.spread
        stacked[count : count + len(q), -1] = np.where(self.known > 0, self.centre, q) / self.outline.spread
        return stacked

    def stepped(self, q: np.ndarray) -> np.ndarray:
        """Return q after a whole Gauss–Newton step."""
        size = len(self.spread)
        factor = np.asarray(np.linalg.qr(self._stacked(q), mode="r"))  # the right side is multiplied, too
        return np.asarray(np.linalg.solve(factor[:size, :size], factor[:size, size])[: len(q)])

    def solved(self, q: np.ndarray) -> _Solution:
        """Return the solution linearised about q."""
        stacked, places = self._stacked(q), self.places
        basis, factor = np.linalg.qr(stacked[:, :-1])
        error = places.error_mm - places.radius_mm * self._unwound(q)[0]
        rest = np.linalg.lstsq(places.columns * self.root[:, None], error * self.root, rcond=None)[0]
        known = (basis[: len(self.root)] ** 2).sum()
        return _Solution(rest, factor, error - places.columns @ rest, max(float(len(self.root) - known), 1.0))

    def improved(self, q: np.ndarray, steps: int) -> np.ndarray:
        """Return q after at most so many Gauss–Newton steps, each shortened until it lowers the cost."""
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
