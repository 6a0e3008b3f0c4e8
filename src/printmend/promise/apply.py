"""Mend only what is known: which parts of a learned machine may act, given what its instrument cannot tell.

A scanner stretches, its axes differ and lean; a printer does so too, and one print shows their sum o = H f + i with the
printer's faults f (a motor's scale, the frame's skew) and the instrument's errors i ~ N(0, S). Each set of faults H is
weighed by its evidence N(o; 0, S + H V Hᵀ); the likeliest acts, with f as large as the least squares with S say, and
the rest stays out. The weighed sets together are what is believed of the printer (`Believed`), for its promise.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.identify.drive import CROSS
from printmend.learn.greybox.model import GreyboxModel, LearnedDrive, frame_of
from printmend.machine import Frame, Mechanism
from printmend.path import Instrument, Trace
from printmend.saved import SCALE_MM, SavedModel, branches_of

SCALE_SD, SKEW_SD = 0.02, 0.01  # prior standard deviations of a faulty scale and of half a faulty skew [rad]
MOST_SKEW_RAD = 0.035  # half of 4°: a frame that leans by more is seen without a test print
FAULT_ODDS = np.exp(-2.0)  # prior odds of each fault
# A slight fault has this share of these standard deviations: it is believed as a doubt, but does not act, because it
# can hardly be told from the instrument's own error.
SLIGHT_SHARE = 0.1
# Where `_faults` lists the frame's skew, and the scales of a CoreXY's motors; and of the sets that mix kinds of scales
# the only two that are tried: both motors' with the x axis's or the y axis's.
SKEW, MOTORS = 1, (4, 5)
BOTH_MOTORS_AND_AXIS = ((2, *MOTORS), (3, *MOTORS))
MOTORS_ODDS = np.exp(-2.0)  # of both motors' scales being wrong, each by its own amount: a skewed frame looks the same
LEAST_WEIGHT = 1e-3  # sets of faults of a smaller weight are left out
SETTLED_MM = 1e-6  # a smaller error along the bed counts as none
SETTLED_SHARE = 1e-5  # a smaller scale, or doubt of one, counts as none: what rounding leaves
WAVE_FACTOR = 3.0  # a wave smaller than so many times the instrument's own unevenness does not act: it may be that
PLACES_COMPARED = 400  # number of places over a motor's reach at which its errors are looked at
# What drifts evenly ends so many times its RMS size from its mean. A scale that is no larger than the drift at the end
# may be of another time than the next print's.
DRIFTED = 3**0.5
WARMED = 3.0  # the mean of what warms up and stays so, a tenth to a third of the print long, over its deviation from it
LINE = " line"  # after a motor's name: its offset, scale and changes of scale
_PART_WORDS = {
    "mean": "pulley",
    "ripple": "micro-step ripple",
    "play": "play",
    "elastic": "elastic belt",
    "warp": "uneven belt",
    "second": "idler",
}


# RMS below which a wave that repeats at no pulley's turn, or what repeats nothing, does not act where a plate was
# scanned at one turn: carriages that run uneven by ten times what a good one does are met, too, and make the same.
CARRIAGE_MM = 0.03
CARRIAGES_SHARE = 0.5  # share of such a wave's variance that is the printer's, as far as anybody knows
TURNED_AXES_SD = 5e-4  # scans at two turns know the difference of the scanner's axes better than that, one does not
ONE_TURN = "no more than a scanner's carriage makes"


@dataclass(frozen=True)
class LeftOut:
    """A part that was found and does not act: its size ± ``sd`` in ``unit``, and why."""

    part: str
    value: float
    sd: float
    unit: str
    why: str


@dataclass(frozen=True, eq=False)
class Believed:
    """How the bed may differ from what acts, as a weighed set of Gaussians: ``weight`` [K], ``mean`` [K, 3] and
    ``covariance`` [K, 3, 3] of common scale, half the difference of both scales, half the skew [rad]."""

    weight: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def json(self) -> list[dict[str, Any]]:
        """Return plain values."""
        return [
            {
                "weight": round(float(weight), 4),
                "mean": [float(f"{value:.4g}") for value in mean],
                "covariance": [[float(f"{value:.4g}") for value in row] for row in covariance],
            }
            for weight, mean, covariance in zip(self.weight, self.mean, self.covariance, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Acting:
    """The machine that may act, the parts of the learned one that were left out, and the belief about its stretch.

    ``still_mm2`` is the variance on the bed of what was left out of either motor because the printer drifts as much, or
    a scanner's carriage may make it, and ``still_sd_mm2`` its doubt: any share of a drift may be there in a next print;
    ``turn_rad`` is by how much a CoreXY's skewed frame turns what it prints, clockwise, where a measurement that knows
    no place does not tell: its x keeps its direction then, and y alone leans.
    """

    fit: GreyboxModel
    left_out: tuple[LeftOut, ...]
    believed: Believed | None
    turn_rad: float = 0.0
    still_mm2: tuple[float, float] = (0.0, 0.0)
    still_sd_mm2: tuple[float, float] = (0.0, 0.0)


def acting(fit: GreyboxModel, trace: Trace, old: SavedModel | None = None, unrest_mm: float = 0.0) -> Acting:
    """Return what of a learned machine may act.

    A new measurement of the machine of an ``old`` model is judged by what it changes: what acted before was known.
    ``unrest_mm`` is what changed by itself while the print was made: a scale that is no more than that does not act.
    """
    instrument = trace.instrument_doubt
    if instrument.is_exact:
        return _still(fit, unrest_mm, trace)
    base = np.zeros(3) if old is None else stretch_of_model(old)
    values = [drive.choice.fit.posterior.values.copy() for drive in fit.drives]
    waves = [_waves(fit, motor, values[motor], instrument) for motor in range(2)]
    x_mm2, y_mm2 = (CARRIAGES_SHARE * sum(each.value**2 for each in one if each.why == ONE_TURN) for one in waves)
    left_out = [*waves[0], *waves[1]]
    found = observed_stretch(fit)
    corexy = fit.printer.kinematics == "corexy"
    believed, applied, skew = believe(found.value - base, found.covariance, instrument, corexy)
    turn_rad = 0.0
    if corexy and not trace.placed:
        leans = 0 < abs(skew) < MOST_SKEW_RAD  # else motors whose scales differ by as much are as likely, and turn none
        turn_rad = _turn_of_model(old) + (_polar(applied)[1] * skew / applied[2] if leans else 0.0)
    excess = found.value - base - applied
    off = _bed(excess, corexy) if trace.placed else found.matrix - _bed(base + applied, corexy)
    if np.abs(off).max() > 0:
        _take_off(fit, values, off)
        sd = np.sqrt(np.diag(found.covariance + _instrument_covariance(instrument)))
        names = ("scale of both axes", "difference of the axes' scales", "skew")
        units, factors = ("%", "%", "°"), (100.0, 200.0, float(np.degrees(2.0)))
        for at in np.flatnonzero(np.abs(excess) > SETTLED_SHARE):
            size, doubt = excess[at] * factors[at], sd[at] * factors[at]
            why = "as likely the instrument's as the printer's"
            left_out.append(LeftOut(names[at], round(float(size), 5), round(float(doubt), 5), units[at], why))
    if all(
        np.array_equal(mine, drive.choice.fit.posterior.values) for mine, drive in zip(values, fit.drives, strict=True)
    ):
        return Acting(fit, (), believed, turn_rad)
    return Acting(_rebuilt(fit, values, trace.placed), tuple(left_out), believed, turn_rad, (x_mm2, y_mm2))


def _still(fit: GreyboxModel, unrest_mm: float, trace: Trace) -> Acting:
    """Return a machine without scales, changes of scale and shifts that are no more than what drifted meanwhile."""
    values, left_out, still_mm2 = [], [], [0.0, 0.0]
    for motor, drive in enumerate(fit.drives if unrest_mm else ()):
        mine = drive.choice.fit.posterior.values.copy()
        powers = drive.choice.design.parts["mean_powers"]
        motor_mm = np.linspace(*drive.branches.reach_mm, PLACES_COMPARED)
        mean, _ = drive.choice.design.columns(motor_mm, drive.branches.period_mm, drive.branches.middle_mm)
        _, play_mm = drive.branches.errors_mm(motor_mm)
        line_mm = mean[:, powers] @ mine[powers]
        size_mm, middle_mm, most_mm = float(np.std(line_mm)), float(np.mean(line_mm)), DRIFTED * unrest_mm
        rests_mm = _middle_from_home_mm(fit, motor, float(np.mean(play_mm))) if trace.homed else 0.0
        shift_mm = middle_mm if abs(middle_mm - rests_mm) > WARMED * unrest_mm else rests_mm
        out_mm = float(np.hypot(size_mm, middle_mm - shift_mm))
        if size_mm <= most_mm and out_mm > SETTLED_MM:
            mine[powers], still_mm2[motor] = 0.0, out_mm**2
            mine[powers.start] = shift_mm
            part = f"{drive.name.upper()}{LINE}"
            why = "no more than what changed while it was printed"
            left_out.append(LeftOut(part, round(out_mm, 5), round(unrest_mm, 5), "mm", why))
        values.append(mine)
    if not left_out:
        return Acting(fit, (), None)
    first, second = still_mm2
    return Acting(
        _rebuilt(fit, values, trace.placed), tuple(left_out), None, still_mm2=(first / 2, second / 2),
        still_sd_mm2=(first / 12**0.5, second / 12**0.5),
    )  # fmt: skip


def _middle_from_home_mm(fit: GreyboxModel, motor: int, play_mm: float) -> float:
    """Return where the middle of a belt's play lies that a homing has pushed to one side; a CoreXY's may be pushed to
    either."""
    if fit.printer.kinematics == "corexy":
        return 0.0
    return -play_mm / 2 if fit.printer.home_mm[motor] < fit.printer.middle_mm[motor] else play_mm / 2


def still_words(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a sentence for each part that a model leaves out because the printer drifts as much while it prints, or
    because a scanner's carriage makes the same."""
    section = document.get("promise")
    left_out = section.get("left_out") if isinstance(section, dict) else None
    found, waves = [], dict[str, float]()
    for each in left_out if isinstance(left_out, list) else ():
        if not isinstance(each, dict) or not isinstance(part := each.get("part"), str):
            continue
        if not isinstance(value := each.get("value"), int | float):
            continue
        if part.endswith(LINE):
            found.append(
                f"note: {part.removesuffix(LINE)} has an error of scale and place of {value:.3f} mm, no more than what "
                "changed by itself while this was printed: mending leaves it as it is"
            )
        elif each.get("why") == ONE_TURN:
            motor = part.partition(" ")[0]
            waves[motor] = max(value, waves.get(motor, 0.0))
    found += [
        f"note: {motor} has a wave of {value:.3f} mm, which a scanner's carriage makes, too: mending leaves it as it "
        "is. Scan the same plate a second time, turned by a quarter, and both are told apart"
        for motor, value in waves.items()
    ]
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Stretch:
    """The linear part of a machine's errors on the bed, ``matrix`` [2, 2]; of this the common scale, half the
    difference of scales, half the skew, ``value`` [3], and their covariance [3, 3] by the fit alone."""

    matrix: np.ndarray
    value: np.ndarray
    covariance: np.ndarray


def believe(
    observed: np.ndarray, fitted: np.ndarray, instrument: Instrument, corexy: bool
) -> tuple[Believed, np.ndarray, float]:
    """Return how the printer's stretch may differ from what acts, what acts [3], and half the skew of the frame that
    this holds [rad]; ``fitted`` [3, 3] is the covariance of ``observed`` [3] by the scatter of the points alone."""
    spread = fitted + _instrument_covariance(instrument)
    parts = _faults(corexy)
    logs, means, covariances, best = [], [], [], None
    for sets, share in _hypotheses(parts):
        columns = np.stack([parts[i] for i in sets], axis=1) if sets else np.zeros((3, 0))
        sds = share * np.array([SKEW_SD if parts[i][2] == 1.0 else SCALE_SD for i in sets])
        whole = spread + (columns * sds**2) @ columns.T
        odds = FAULT_ODDS ** len(sets) * (MOTORS_ODDS if set(MOTORS) <= set(sets) else 1.0)
        log = np.log(odds) - 0.5 * (np.linalg.slogdet(whole)[1] + observed @ np.linalg.solve(whole, observed))
        gain = (columns * sds**2) @ columns.T @ np.linalg.inv(whole)
        logs.append(float(log))
        means.append(gain @ observed)
        covariances.append((columns * sds**2) @ columns.T - gain @ (columns * sds**2) @ columns.T)
        if (best is None or log > best[0]) and share == 1.0:
            best = (log, _least_squares(columns, spread, observed), columns, sets)
    assert best is not None
    weight = np.exp(np.array(logs) - max(logs))
    weight /= weight.sum()
    keep = weight > LEAST_WEIGHT
    believed = Believed(weight[keep] / weight[keep].sum(), np.array(means)[keep] - best[1], np.array(covariances)[keep])
    _, acts, columns, sets = best
    skew = float(np.linalg.lstsq(columns, acts, rcond=None)[0][sets.index(SKEW)]) if SKEW in sets else 0.0
    return believed, acts, skew


def _least_squares(columns: np.ndarray, spread: np.ndarray, observed: np.ndarray) -> np.ndarray:
    if columns.shape[1] == 0:
        return np.zeros(3)
    if np.linalg.matrix_rank(columns) == 3:
        return observed.copy()
    weighed = np.linalg.solve(spread, columns)
    return np.asarray(columns @ np.linalg.solve(columns.T @ weighed, weighed.T @ observed))


def _instrument_covariance(instrument: Instrument) -> np.ndarray:
    covariance = instrument.covariance
    least = SETTLED_SHARE**2 - np.diag(covariance)
    return covariance + np.diag(np.maximum(least, 0.0))


def _faults(corexy: bool) -> list[np.ndarray]:
    """Return what a printer's own faults do [3]: both scales alike, the frame's skew, each axis's scale, and on a
    CoreXY each motor's: its belt runs along a diagonal, so its scale stretches and leans."""
    axes = [np.array([0.5, 0.5, 0.0]), np.array([0.5, -0.5, 0.0])]
    motors = [np.array([0.5, 0.0, 0.5]), np.array([0.5, 0.0, -0.5])] if corexy else []
    return [np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), *axes, *motors]


def _turn_of_model(model: SavedModel | None) -> float:
    """Return by how much [rad] the frame of a saved machine turns what it prints, clockwise."""
    if model is None:
        return 0.0
    frame = model.mechanism.frame
    right, up = (Frame.exponents.index(powers) for powers in ((1, 0), (0, 1)))
    return float(frame.coefficients_mm[0, up] - frame.coefficients_mm[1, right]) / (2 * frame.scale_mm)


def _hypotheses(parts: Sequence[np.ndarray]) -> list[tuple[tuple[int, ...], float]]:
    """Return all sets of ``parts`` that say nothing twice, of usual size and slight, as a share of that.

    No set has both scales alike and one of them, or an axis's scale and a motor's, but both motors' and one axis's.
    """
    kinds = ({0}, {2, 3}, {4, 5})
    every = itertools.chain.from_iterable(itertools.combinations(range(len(parts)), size) for size in range(4))
    sets = [
        each for each in every
        if each in BOTH_MOTORS_AND_AXIS or (
            sum(bool(kind & set(each)) for kind in kinds) < 2 and not {SKEW, *MOTORS} <= set(each)
        )
    ]  # fmt: skip
    return [*((each, 1.0) for each in sets), *((each, SLIGHT_SHARE) for each in sets if each)]


def observed_stretch(fit: GreyboxModel) -> Stretch:
    """Return the stretch of a learned machine on the bed."""
    to_motor = fit.printer.to_motor(np.eye(2)).T
    stretch, columns, variances = np.zeros((2, 2)), [], []
    for motor, drive in enumerate(fit.drives):
        post, parts = drive.choice.fit.posterior, drive.choice.design.parts
        sds = np.zeros(drive.choice.design.size)
        sds[post.active] = np.sqrt(np.diag(post.covariance))
        own, cross = parts["mean_powers"], parts["cross"]
        places = ((own.start + 1, own.stop - own.start > 1, motor), (cross.start, cross.stop > cross.start, 1 - motor))
        for at, there, column in places:
            unit = np.zeros((2, 2))
            unit[motor, column] = 1.0
            on_bed = np.linalg.inv(to_motor) @ unit @ to_motor
            if there:
                stretch += on_bed * post.values[at] / SCALE_MM
            columns.append(_stretch_of(on_bed))
            variances.append(max(sds[at] / SCALE_MM if there else 0.0, SETTLED_SHARE) ** 2)
    gather = np.stack(columns, axis=1)
    return Stretch(stretch, _stretch_of(stretch), (gather * np.array(variances)) @ gather.T)


def stretch_of_model(model: SavedModel) -> np.ndarray:
    """Return the stretch [3] of a saved machine, by the slopes of its series and the linear part of its frame."""
    printer, frame = model.printer, model.mechanism.frame
    to_motor = printer.to_motor(np.eye(2)).T
    slopes = np.zeros(2)
    for motor in range(2):
        branches = branches_of(model, motor)
        if branches is not None and len(branches.mean.powers_mm) > 1:
            slopes[motor] = branches.mean.powers_mm[1] / SCALE_MM
    linear = [Frame.exponents.index((1, 0)), Frame.exponents.index((0, 1))]
    on_bed = np.linalg.inv(to_motor) @ np.diag(slopes) @ to_motor
    return _stretch_of(on_bed + frame.coefficients_mm[:, linear] / frame.scale_mm)


def _stretch_of(matrix: np.ndarray) -> np.ndarray:
    """Return the stretch [3] of a linear error [2, 2], turned so that x keeps its direction."""
    turned = np.linalg.qr(np.eye(2) + matrix, mode="r")
    (right, lean), (_, up) = np.sign(np.diag(turned))[:, None] * turned - np.eye(2)
    return np.array([right + up, right - up, lean]) / 2


def _bed(stretch: np.ndarray, corexy: bool) -> np.ndarray:
    """Return a stretch [3] as a linear error [2, 2]: no turn on a CoreXY; else x keeps its direction."""
    return _polar(stretch)[0] if corexy else _leaning(stretch)


def _leaning(stretch: np.ndarray) -> np.ndarray:
    common, half, lean = stretch
    return np.array([[common + half, 2 * lean], [0.0, common - half]])


def _polar(stretch: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a stretch as an error [2, 2] that turns nothing, and how far x has to turn back, clockwise [rad]."""
    whole = np.eye(2) + _leaning(stretch)
    turn_rad = float(np.arctan2(whole[0, 1] - whole[1, 0], whole.trace()))
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.array([[cos, -sin], [sin, cos]]) @ whole - np.eye(2), turn_rad


def _take_off(fit: GreyboxModel, values: list[np.ndarray], matrix: np.ndarray) -> None:
    """Take a linear error on the bed [2, 2] off the parameters [P] of both motors, where they have a place for it."""
    to_motor = fit.printer.to_motor(np.eye(2)).T
    belts = SCALE_MM * to_motor @ matrix @ np.linalg.inv(to_motor)
    for motor, drive in enumerate(fit.drives):
        parts = drive.choice.design.parts
        own, cross = parts["mean_powers"], parts["cross"]
        if own.stop - own.start > 1:
            values[motor][own.start + 1] -= belts[motor, motor]
        if cross.stop > cross.start:
            values[motor][cross.start] -= belts[motor, 1 - motor]


def _waves(fit: GreyboxModel, motor: int, values: np.ndarray, instrument: Instrument) -> Sequence[LeftOut]:
    """Set to 0 what is no larger than the unevenness of the instrument, and return it."""
    drive = fit.drives[motor]
    design, branches = drive.choice.design, drive.branches
    motor_mm = np.linspace(*branches.reach_mm, PLACES_COMPARED)
    mean, play = design.columns(motor_mm, branches.period_mm, branches.middle_mm)
    seen = []
    for name, word in _PART_WORDS.items():
        mask = design.mask(name) if name != "play" else design.mask("play_powers", "play")
        columns = play if name == "play" else mean
        seen.append((mask, _rms(columns[:, mask] @ values[mask]), word))
    drift, bent = design.mask("mean_powers"), design.mask("cross")
    drift[design.parts["mean_powers"].start :][:2] = False
    changes, line = mean[:, drift] @ values[drift], np.vander(motor_mm, 2)
    seen.append((drift, _rms(changes - line @ np.linalg.lstsq(line, changes, rcond=None)[0]), "changing scale"))
    bent[design.parts["cross"]] = [p + q > 1 for p, q in CROSS[: len(design.cross)]]
    seen.append((bent, float(np.linalg.norm(values[bent])), "bent guides"))
    found = []
    least_mm = WAVE_FACTOR * instrument.wave_mm
    carriage_mm = CARRIAGE_MM if instrument.wave_mm and instrument.axes_sd > TURNED_AXES_SD else 0.0
    carriages = [_PART_WORDS["warp"], _PART_WORDS["second"]]
    if branches.period_mm != fit.printer.axes[motor].mm_per_turn:
        carriages += [_PART_WORDS["mean"], _PART_WORDS["elastic"]]
    for mask, size, word in seen:
        is_carriages = least_mm < size <= carriage_mm and word in carriages
        if 0 < size <= least_mm or is_carriages:
            values[mask] = 0.0
            why = ONE_TURN if is_carriages else "no more than the instrument makes"
            found.append(LeftOut(f"{drive.name.upper()} {word}", round(size, 5), instrument.wave_mm, "mm", why))
    return found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _rebuilt(fit: GreyboxModel, values: list[np.ndarray], placed: bool) -> GreyboxModel:
    drives: list[LearnedDrive] = []
    for drive, mine in zip(fit.drives, values, strict=True):
        offset = drive.choice.design.parts["mean_powers"]
        if not placed and not np.delete(mine, [0, offset.start] if offset.stop > offset.start else [0]).any():
            mine[offset] = 0.0  # where the plate lay is no fault
        branches = drive.choice.design.branches(
            mine,
            period_mm=drive.branches.period_mm,
            origin_mm=drive.branches.middle_mm,
            reach_mm=drive.branches.reach_mm,
        )
        post = replace(drive.choice.fit.posterior, values=mine)
        choice = replace(drive.choice, fit=replace(drive.choice.fit, posterior=post))
        drives.append(replace(drive, branches=branches, choice=choice))
    frame = replace(frame_of(fit.printer, [drive.choice for drive in drives]), waves=fit.mechanism.frame.waves)
    tables = (drives[0].branches.lower(fit.printer, 0), drives[1].branches.lower(fit.printer, 1))
    mechanism = Mechanism(fit.printer, tables, frame, rest_share=fit.mechanism.rest_share)
    return replace(fit, mechanism=mechanism, drives=(drives[0], drives[1]))
