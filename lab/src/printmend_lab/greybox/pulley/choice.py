"""Complete a pulley of which less than a turn was seen, where its kind has so few parameters that a part tells them.

The outlines of `outline` are fitted to a motor's rows at the contacts of its grey box. An outline is believed where it
explains the rows decisively better than a series that fits any pulley, and where its residuals have no pattern. Without
noise the truth is then next to certain; with noise only regular shapes pass. The outlines that pass are mixed by their
evidence, and the mixture is written in the grey box's own parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from printmend.model import SCALE_MM
from printmend.units import TURN_RAD
from printmend_lab.greybox.drive import Design, Rows, contacts
from printmend_lab.greybox.drive.fit import MACHINES, SEED, Fit, Posterior, drawn_about, robust_weights, seen_share
from printmend_lab.greybox.drive.select import HARMONICS, Choice
from printmend_lab.greybox.pulley.outline import (
    ANGLES,
    ANY_PULLEY,
    OUTLINES,
    ROUND,
    EggOutline,
    FlatOutline,
    Outline,
    SeriesOutline,
    series,
)

# Fit outlines to a motor's measured places, and weigh them by their evidence.
#
# At the motor's angle θ the belt is at m + r₀ (U(θ; q) − θ) + Σ columns · nuisance, with U of `outline`. A print on a
# lattice visits each place many times, and the means of the places are fitted. The scatter at one place is noise. What
# an outline leaves of the means is a second variance, estimated for each outline: for the true one it is next to zero
# where the print has no noise, and then all of q is known, whether it was seen or not. The evidence is Laplace's
# (physics.md eq. 20), with proper priors.

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


WHOLE_TURN = 0.999  # share of a turn that counts as all of it: nothing is left to complete
DECISIVE_NATS = 6.0  # log evidence that an outline must have over every series of `ANY_PULLEY` (odds of 400 to 1)
RIVALS_NATS = 12.0  # outlines whose log evidence is less than the best by more than this are not mixed (6e-6 of it)
# von Neumann's ratio Σ (r_i − r_{i−1})² / Σ r² of the residuals by angle: 2 for white noise, 0 for a smooth pattern
LEAST_NEUMANN_RATIO = 1.0
ARITHMETIC_MM = 20 * LEAST_LEFT_MM  # residuals below this are rounding, and their pattern says nothing
MOST_PLACES = 160  # places of a print without noise that are fitted, evenly spread: more cost time and tell nothing new
NOISELESS_MM = 0.005  # a print with less noise than this is fitted place by place, not averaged
CELLS_PER_TURN = 256  # cells in which a noisy print is averaged: 0.16 mm of a turn of 40 mm
LEAST_PLACES = 12  # fewer places than this tell no outline
# Prior standard deviations of where the plate lay and of the play: hardly anything is known of either.
OFFSET_PLAY_SD_MM = (50.0, 5.0)
SETTLED_ANGLE_RAD = 0.3  # an outline whose turn is less well known than this says no more than a round one
HIDDEN_FLAT_ODDS = 0.3  # prior odds that a round pulley has a flat where nobody looked: filed on a shaft, or worn
HIDDEN_FLAT_MM = 1e-6  # a flat that would move a seen place by more than this would have shown
SERIES_END_MM = 1e-4  # standard deviation that a corner keeps because its series ends at the last harmonic
_PHI = np.linspace(0.0, TURN_RAD, ANGLES, endpoint=False)


def outlined(rows: Rows, choice: Choice, complete: Callable[[Rows, Choice], Choice]) -> Choice:
    """Return the choice with its pulley replaced by the believed outline; where none is, return ``complete``'s answer.

    In a noisy print an outline must also leave the turn more certain than ``complete`` does: half a rounded triangle
    looks like half of one with sharp corners, and beyond these nothing is known.
    """
    found = None
    if seen_share(rows, choice.fit.touch) < WHOLE_TURN and _applies(choice):
        found = _found(rows, choice)
    if found is not None and found.fit.posterior.sigma_mm < NOISELESS_MM:
        return found
    usual = complete(rows, choice)
    return usual if found is None or _unsure_mm(rows, found) > _unsure_mm(rows, usual) else found


def _found(rows: Rows, choice: Choice) -> Choice | None:
    """Return the choice with the believed outlines as its pulley; None where no outline is believed."""
    places = _places(rows, choice)
    believed = _believed(places) if len(places) >= LEAST_PLACES else []
    if not believed:
        return None
    structure = replace(choice.structure, pulley="all", scale=True, offset=True)
    design = structure.design(HARMONICS, choice.design.ripple, rows.reach_mm)
    start = design.moved(choice.fit.posterior.values, choice.design)
    post, machines = _posterior(design, start, choice, rows, places, believed)
    touch = contacts(design, post.values, rows)
    loss = float(np.abs(touch.residual_mm[rows.weight > 0]).mean())
    return Choice(structure, design, Fit(post, choice.fit.normal, touch, loss, 1.0), machines)


def _unsure_mm(rows: Rows, choice: Choice) -> float:
    """Return the largest standard deviation within a turn about the middle of what was seen, the offset taken off."""
    at = np.mean(rows.reach_mm) + rows.period_mm * np.linspace(-0.5, 0.5, 41)
    mean, _ = choice.design.columns(at, rows.period_mm, rows.origin_mm)
    post = choice.fit.posterior
    columns = (mean - mean[20])[:, post.active]
    return float(np.sqrt(np.einsum("ij,jk,ik->i", columns, post.covariance, columns).max()))


def _applies(choice: Choice) -> bool:
    """Say whether an outline says all about both branches: play is constant, or that of a loose belt."""
    structure = choice.structure
    plain = structure.play != "free" and not (structure.elastic or structure.drift or structure.warp_mm)
    return plain and not structure.friction and (structure.scale or structure.pulley != "none")


def _places(rows: Rows, choice: Choice) -> MotorPlaces:
    """Return what was measured at the last contacts; what the frame adds is subtracted with the grey box's estimate."""
    touch, post = choice.fit.touch, choice.fit.posterior
    weight = robust_weights(rows, touch.residual_mm, max(post.sigma_mm, NOISELESS_MM), drop=True)
    used = np.flatnonzero((weight > 0) & (touch.at >= 0))
    motor, side = rows.motor_mm[touch.at[used]], touch.side[used].astype(float)
    error, residual = touch.belt_mm[used] + touch.residual_mm[used] - motor, touch.residual_mm[used]
    played = choice.structure.play != "none"
    side *= played
    keys = np.column_stack([np.round(motor, 7), side])
    first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)[1:]
    if len(first) > MOST_PLACES and post.sigma_mm < NOISELESS_MM:
        first = first[np.linspace(0, len(first) - 1, MOST_PLACES).astype(np.int64)]
        group, error, motor, side = np.arange(MOST_PLACES), error[first], motor[first], side[first]
        first = group
    elif len(first) > MOST_PLACES:
        keys = np.column_stack([np.floor(motor * (CELLS_PER_TURN / rows.period_mm)), side])
        first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)[1:]
        # The grey box carries each error to the first place of its cell; over a cell it is right to within the noise.
        error = (error - residual)[first][group.ravel()] + residual
    group = group.ravel()
    count = np.bincount(group).astype(float)
    mean = np.bincount(group, error) / count
    spare = len(error) - len(count)
    noise = float(np.sqrt(((error - mean[group]) ** 2).sum() / spare)) if spare else 0.0
    motor, side = motor[first], side[first]
    # the second span of a loose belt leaves the pulley half a turn away from the first
    half = np.pi * (side > 0) if choice.structure.play == "loose" else 0.0
    columns = np.column_stack([np.ones(len(motor)), side / 2] if played else [np.ones(len(motor))])
    radius = rows.period_mm / TURN_RAD
    angle = motor / radius - half
    return MotorPlaces(
        radius, motor, angle, side, mean, columns, np.array(OFFSET_PLAY_SD_MM)[: columns.shape[1]], count, noise
    )


def _believed(places: MotorPlaces) -> list[OutlineFit]:
    """Return the outlines that are believed, the most likely first."""
    found = [fitted_outline(outline, places) for outline in OUTLINES]
    best = max(each.log_evidence for each in found)
    passed = [each for each in found if each.log_evidence > best - RIVALS_NATS]
    passed = [each for each in passed if _is_patternless(each, places) and _is_settled(each)]
    for outline in ANY_PULLEY if passed else ():
        least = fitted_outline(outline, places).log_evidence + DECISIVE_NATS
        passed = [each for each in passed if each.log_evidence > least]
        if not passed:  # the remaining series need not be fitted
            break
    passed.sort(key=lambda each: -each.log_evidence)
    # A pulley that is round where it was seen is taken for round, not for the round end of an egg.
    return [each for each in passed if each.outline in ROUND] if passed and passed[0].outline in ROUND else passed


def _is_patternless(found: OutlineFit, places: MotorPlaces) -> bool:
    """Say whether the residuals, in the order of their angles, look like noise."""
    if found.left_mm <= ARITHMETIC_MM:
        return True
    left = found.residual_mm[np.argsort(places.angle_rad)] * np.sqrt(places.rows)
    return float((np.diff(left) ** 2).sum()) > LEAST_NEUMANN_RATIO * float((left**2).sum())


def _is_settled(found: OutlineFit) -> bool:
    """Say whether the rows settle every angle of an outline, and every disc: else a simpler outline says as much."""
    sds = np.sqrt(np.diag(found.covariance))[: len(found.q)]
    disc = found.outline.spread / 2 if isinstance(found.outline, EggOutline) else np.inf
    return bool((sds < np.where(np.isnan(found.outline.centre), SETTLED_ANGLE_RAD, disc)).all())


def _posterior(
    design: Design, start: np.ndarray, choice: Choice, rows: Rows, places: MotorPlaces, believed: list[OutlineFit]
) -> tuple[Posterior, np.ndarray]:
    """Mix the outlines by their evidence; return the mean [P] and covariance [P, P] of the grey box's parameters, and
    how far from the mean `MACHINES` lie that are as likely as one another [P, R]."""
    shares = np.exp([each.log_evidence - believed[0].log_evidence for each in believed])
    shares /= shares.sum()
    loose = choice.structure.play == "loose"
    lowered = [_lowered(each, design, start, rows, places, loose) for each in believed]
    mean = sum(share * values for share, (values, _, _) in zip(shares, lowered, strict=True))
    covariance = np.zeros((design.size, design.size))
    rng = np.random.default_rng(SEED)
    which = np.searchsorted(np.cumsum(shares), (np.arange(MACHINES) + rng.uniform()) / MACHINES * shares.sum())
    machines = np.zeros((design.size, MACHINES))
    for at, (share, (values, own, flats)) in enumerate(zip(shares, lowered, strict=True)):
        hidden = HIDDEN_FLAT_ODDS / len(flats) * flats.T @ flats if len(flats) else 0.0
        covariance += share * (own + hidden + np.outer(values - mean, values - mean))
        mine = which == at
        machines[:, mine] = (values - mean)[:, None] + drawn_about(own, int(mine.sum()), rng)
        if len(flats):
            there = rng.uniform(size=MACHINES) < HIDDEN_FLAT_ODDS
            machines += np.where(mine & there, flats[rng.integers(len(flats), size=MACHINES)].T, 0.0)
    left = np.hypot(believed[0].left_mm, places.noise_mm)
    everything = np.ones(design.size, bool)
    post = Posterior(mean, covariance, everything, float(left), choice.fit.posterior.prior, believed[0].log_evidence)
    return post, machines


def _lowered(
    found: OutlineFit, design: Design, start: np.ndarray, rows: Rows, places: MotorPlaces, loose: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return an outline as parameters [P] of the grey box, their covariance [P, P], and what each flat that a round one
    may have where nobody looked would add [F, P]: 0 for one that would have shown."""
    q, count = found.q, len(found.q)
    to = to_parameters(design, rows.period_mm, loose=loose)
    steps = 1e-6 * np.eye(count)
    slopes = [_series(found.outline, q + step) - _series(found.outline, q - step) for step in steps]
    shaped = to.any(axis=1)
    values = np.where(shaped, to @ _series(found.outline, q), start)
    jacobian = np.zeros((design.size, count + len(found.rest)))
    jacobian[:, :count] = to @ np.array(slopes).T / 2e-6
    # Offset and play are chosen such that the series lies on the outline at the measured places.
    mean, play = design.columns(places.motor_mm, rows.period_mm, rows.origin_mm)
    columns = mean + places.side[:, None] / 2 * play
    rest = [design.place_at, design.play_at][: len(found.rest)]
    columns[:, rest] = 0.0
    value, slope = found.outline.unwound(q, places.angle_rad)
    at = places.radius_mm * value + places.columns @ found.rest
    moved = np.concatenate([places.radius_mm * slope, places.columns], axis=1)
    nearest = np.linalg.pinv(places.columns)
    values[rest] = nearest @ (at - columns @ values)
    jacobian[rest] = nearest @ (moved - columns @ jacobian)
    covariance = jacobian @ found.covariance @ jacobian.T + SERIES_END_MM**2 * np.diag(shaped)
    hidden = []
    if found.outline in ROUND:
        flats = FlatOutline(bored=True)
        bore = (q[1], q[2]) if count > 1 else (0.0, 0.0)
        for size, turn, half, *_ in flats.starts():
            hidden.append(np.zeros(design.size))
            flat = np.array([size * (1 + q[0]), turn, half, *bore])
            gone = places.radius_mm * (flats.unwound(flat, places.angle_rad)[0] - value)
            if np.abs(gone - places.columns @ (nearest @ gone)).max() < HIDDEN_FLAT_MM:
                away = to @ (_series(flats, flat) - _series(found.outline, q))
                away[rest] = -nearest @ (columns @ away)
                hidden[-1] = away
    return values, covariance, np.array(hidden).reshape(-1, design.size)


def _series(outline: Outline, q: np.ndarray) -> np.ndarray:
    """Return an outline as a shape [1 + 2K] of `shapes`."""
    return series(outline.heights(q, _PHI)[None])[0]


def to_parameters(design: Design, period_mm: float, *, loose: bool = False) -> np.ndarray:
    """Return the map [P, D] from a shape of `shapes` to parameters.

    With dx/dθ = h(−θ) (physics.md eq. 1), h = r + Σ A_k cos + B_k sin gives r₀ Σ (A_k/k) sin kθ + (B_k/k) cos kθ; the
    odd harmonics of a ``loose`` belt are opposite on its two spans (eq. 7).
    """
    radius_mm = period_mm / TURN_RAD
    to = np.zeros((design.size, 1 + 2 * HARMONICS))
    to[design.scale_at, 0] = SCALE_MM
    k = np.arange(HARMONICS)
    to[design.parts["mean_sin"].start + k, 1 + k] = radius_mm
    to[design.parts["mean_cos"].start + k, 1 + HARMONICS + k] = radius_mm
    if loose:
        for part in ("cos", "sin"):
            mean, play = design.parts[f"mean_{part}"], design.parts[f"play_{part}"]
            odd = mean.start + design.waves("play") - 1
            to[play], to[odd] = -2.0 * to[odd], 0.0
    return to
