"""Where less than a turn was seen: is the pulley of a kind whose seen part says all of it?

The outlines of `outline` are fitted to the rows of a motor at the contacts of its grey box. One is believed where it
explains them decisively better than any pulley could, and leaves no pattern: without noise that is next to certain,
with noise only regular shapes pass. Those that pass are mixed by evidence, into the grey box's own parameters.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from printmend.learn.drive.design import Design, Rows, contacts
from printmend.learn.drive.fit import Fit, Posterior, robust_weights
from printmend.learn.drive.select import HARMONICS, Choice
from printmend.learn.drive.sight import sight
from printmend.learn.pulley.fit import FLOOR_MM, Fitted, Places, fitted
from printmend.learn.pulley.outline import OUTLINES, PLAIN, ROUND, Egg, Flat, Outline
from printmend.learn.pulley.shapes import ANGLES, series
from printmend.saved.branches import SCALE_MM
from printmend.units import TURN_RAD

WHOLE = 0.999  # of a turn
DECISIVE = 6.0  # nats over any pulley
NEAR = 12.0  # nats below the best that still count
WHITE = 1.0  # of Σ (r_i − r_{i−1})² / Σ r²: 2 for noise, 0 for a pattern
EXACT_MM = 20 * FLOOR_MM  # a smaller pattern is arithmetic's
MOST = 160  # places that are looked at
CALM_MM = 0.005  # a print with less noise has none: then its rows are taken one by one, not averaged
CELLS = 256
LEAST = 12  # places that are too few to tell anything
REST_MM = (50.0, 5.0)  # where the plate lay, and play
SETTLED_RAD = 0.3
HIDDEN, HIDDEN_MM = 0.3, 1e-6  # how likely a round pulley has a flat where nobody looked; what would have shown
CUT_MM = 1e-4  # corners end at the last harmonic
_PHI = np.linspace(0.0, TURN_RAD, ANGLES, endpoint=False)


def outlined(rows: Rows, choice: Choice, complete: Callable[[Rows, Choice], Choice]) -> Choice:
    """Return the choice with its pulley as an outline says it is; ``complete`` says it where none is believed.

    Where there is noise an outline must also be surer of the turn than what it replaces: half a rounded triangle looks
    like one with sharp corners, of which nothing is known beyond them.
    """
    found = None
    if sight(rows, choice.fit.touch).angles < WHOLE and _applies(choice):
        found = _found(rows, choice)
    if found is not None and found.fit.posterior.sigma_mm < CALM_MM:
        return found
    usual = complete(rows, choice)
    return usual if found is None or _unsure_mm(rows, found) > _unsure_mm(rows, usual) else found


def _found(rows: Rows, choice: Choice) -> Choice | None:
    places = _places(rows, choice)
    believed = _believed(places) if len(places) >= LEAST else []
    if not believed:
        return None
    structure = replace(choice.structure, pulley="all", scale=True, offset=True)
    design = structure.design(HARMONICS, choice.design.ripple, rows.reach_mm)
    start = design.moved(choice.fit.posterior.values, choice.design)
    post = _posterior(design, start, choice, rows, places, believed)
    touch = contacts(design, post.values, rows)
    loss = float(np.abs(touch.residual_mm[rows.weight > 0]).mean())
    return Choice(structure, design, Fit(post, choice.fit.normal, touch, loss, 1.0))


def _unsure_mm(rows: Rows, choice: Choice) -> float:
    """Return the largest standard deviation within a turn about the middle of what was seen, the offset taken off."""
    at = np.mean(rows.reach_mm) + rows.period_mm * np.linspace(-0.5, 0.5, 41)
    mean, _ = choice.design.columns(at, rows.period_mm, rows.origin_mm)
    post = choice.fit.posterior
    columns = (mean - mean[20])[:, post.active]
    return float(np.sqrt(np.einsum("ij,jk,ik->i", columns, post.covariance, columns).max()))


def _applies(choice: Choice) -> bool:
    """An outline says what both branches do where play is constant, or a belt hangs loose about the pulley."""
    structure = choice.structure
    plain = structure.play != "free" and not (structure.elastic or structure.drift or structure.warp_mm)
    return plain and not structure.friction and (structure.scale or structure.pulley != "none")


def _places(rows: Rows, choice: Choice) -> Places:
    """Return what was measured where the belt last touched, what the frame adds taken off as the grey box has it."""
    touch, post = choice.fit.touch, choice.fit.posterior
    weight = robust_weights(rows, touch.residual_mm, max(post.sigma_mm, CALM_MM), drop=True)
    used = np.flatnonzero((weight > 0) & (touch.at >= 0))
    motor, side = rows.motor_mm[touch.at[used]], touch.side[used].astype(float)
    error, residual = touch.belt_mm[used] + touch.residual_mm[used] - motor, touch.residual_mm[used]
    played = choice.structure.play != "none"
    side *= played
    keys = np.column_stack([np.round(motor, 7), side])
    first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)[1:]
    if len(first) > MOST and post.sigma_mm < CALM_MM:
        first = first[np.linspace(0, len(first) - 1, MOST).astype(np.int64)]
        group, error, motor, side = np.arange(MOST), error[first], motor[first], side[first]
        first = group
    elif len(first) > MOST:
        keys = np.column_stack([np.floor(motor * (CELLS / rows.period_mm)), side])
        first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)[1:]
        # carried to the first place of its cell by the grey box, which is right as far as there is noise
        error = (error - residual)[first][group.ravel()] + residual
    group = group.ravel()
    count = np.bincount(group).astype(float)
    mean = np.bincount(group, error) / count
    spare = len(error) - len(count)
    noise = float(np.sqrt(((error - mean[group]) ** 2).sum() / spare)) if spare else 0.0
    motor, side = motor[first], side[first]
    half = np.pi * (side > 0) if choice.structure.play == "loose" else 0.0  # the other span leaves on the other side
    columns = np.column_stack([np.ones(len(motor)), side / 2] if played else [np.ones(len(motor))])
    radius = rows.period_mm / TURN_RAD
    angle = motor / radius - half
    return Places(radius, motor, angle, side, mean, columns, np.array(REST_MM)[: columns.shape[1]], count, noise)


def _believed(places: Places) -> list[Fitted]:
    """Return the outlines that pass, the most likely first."""
    found = [fitted(outline, places) for outline in OUTLINES]
    best = max(each.log_evidence for each in found)
    passed = [each for each in found if each.log_evidence > best - NEAR]
    passed = [each for each in passed if _is_white(each, places) and _is_settled(each)]
    for outline in PLAIN if passed else ():
        least = fitted(outline, places).log_evidence + DECISIVE
        passed = [each for each in passed if each.log_evidence > least]
        if not passed:  # the others need no look
            break
    passed.sort(key=lambda each: -each.log_evidence)
    # what is round where it was seen is not thought to be one end of something longer
    return [each for each in passed if each.outline in ROUND] if passed and passed[0].outline in ROUND else passed


def _is_white(found: Fitted, places: Places) -> bool:
    if found.left_mm <= EXACT_MM:
        return True
    left = found.residual_mm[np.argsort(places.angle_rad)] * np.sqrt(places.rows)
    return float((np.diff(left) ** 2).sum()) > WHITE * float((left**2).sum())


def _is_settled(found: Fitted) -> bool:
    """An outline with an angle that may be any, or a disc that nothing touched, says no more than a simpler one."""
    sds = np.sqrt(np.diag(found.covariance))[: len(found.q)]
    disc = found.outline.spread / 2 if isinstance(found.outline, Egg) else np.inf
    return bool((sds < np.where(np.isnan(found.outline.centre), SETTLED_RAD, disc)).all())


def _posterior(
    design: Design, start: np.ndarray, choice: Choice, rows: Rows, places: Places, believed: list[Fitted]
) -> Posterior:
    """Mix the outlines by evidence: the mean and covariance [P] of the grey box's parameters."""
    shares = np.exp([each.log_evidence - believed[0].log_evidence for each in believed])
    shares /= shares.sum()
    loose = choice.structure.play == "loose"
    lowered = [_lowered(each, design, start, rows, places, loose) for each in believed]
    mean = sum(share * values for share, (values, _) in zip(shares, lowered, strict=True))
    covariance = np.zeros((design.size, design.size))
    for share, (values, own) in zip(shares, lowered, strict=True):
        covariance += share * (own + np.outer(values - mean, values - mean))
    left = np.hypot(believed[0].left_mm, places.noise_mm)
    everything = np.ones(design.size, bool)
    return Posterior(mean, covariance, everything, float(left), choice.fit.posterior.prior, believed[0].log_evidence)


def _lowered(
    found: Fitted, design: Design, start: np.ndarray, rows: Rows, places: Places, loose: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return an outline as parameters [P] of the grey box, and their covariance [P, P]."""
    q, count = found.q, len(found.q)
    to = to_parameters(design, rows.period_mm, loose=loose)
    steps = 1e-6 * np.eye(count)
    slopes = [_series(found.outline, q + step) - _series(found.outline, q - step) for step in steps]
    shaped = to.any(axis=1)
    values = np.where(shaped, to @ _series(found.outline, q), start)
    jacobian = np.zeros((design.size, count + len(found.rest)))
    jacobian[:, :count] = to @ np.array(slopes).T / 2e-6
    # offset and play are what puts the series where the outline was at the places
    mean, play = design.columns(places.motor_mm, rows.period_mm, rows.origin_mm)
    columns = mean + places.side[:, None] / 2 * play
    rest = [design.parts[part].start for part in ("mean_powers", "play_powers")][: len(found.rest)]
    columns[:, rest] = 0.0
    value, slope = found.outline.unwound(q, places.angle_rad)
    at = places.radius_mm * value + places.columns @ found.rest
    moved = np.concatenate([places.radius_mm * slope, places.columns], axis=1)
    nearest = np.linalg.pinv(places.columns)
    values[rest] = nearest @ (at - columns @ values)
    jacobian[rest] = nearest @ (moved - columns @ jacobian)
    covariance = jacobian @ found.covariance @ jacobian.T + CUT_MM**2 * np.diag(shaped)
    if found.outline in ROUND:
        flats = Flat(bored=True)
        bore = (q[1], q[2]) if count > 1 else (0.0, 0.0)
        for size, turn, half, *_ in flats.starts():
            flat = np.array([size * (1 + q[0]), turn, half, *bore])
            gone = places.radius_mm * (flats.unwound(flat, places.angle_rad)[0] - value)
            if np.abs(gone - places.columns @ (nearest @ gone)).max() < HIDDEN_MM:
                away = to @ (_series(flats, flat) - _series(found.outline, q))
                away[rest] = -nearest @ (columns @ away)
                covariance += HIDDEN / len(flats.starts()) * np.outer(away, away)
    return values, covariance


def _series(outline: Outline, q: np.ndarray) -> np.ndarray:
    return series(outline.heights(q, _PHI)[None])[0]


def to_parameters(design: Design, period_mm: float, *, loose: bool = False) -> np.ndarray:
    """Return the map [P, D] from a shape of `shapes` to parameters.

    With dx/dθ = h(−θ) (physics.md eq. 1), h = r + Σ A_k cos + B_k sin gives r₀ Σ (A_k/k) sin kθ + (B_k/k) cos kθ; the
    odd harmonics of a ``loose`` belt are opposite on its two spans (eq. 7).
    """
    radius_mm = period_mm / TURN_RAD
    to = np.zeros((design.size, 1 + 2 * HARMONICS))
    to[design.parts["mean_powers"].start + 1, 0] = SCALE_MM
    k = np.arange(HARMONICS)
    to[design.parts["mean_sin"].start + k, 1 + k] = radius_mm
    to[design.parts["mean_cos"].start + k, 1 + HARMONICS + k] = radius_mm
    if loose:
        for part in ("cos", "sin"):
            mean, play = design.parts[f"mean_{part}"], design.parts[f"play_{part}"]
            odd = mean.start + design.waves("play") - 1
            to[play], to[odd] = -2.0 * to[odd], 0.0
    return to
