"""The learner ``meta``: one forward pass of a network says what to believe of a drive, a closed form does the rest.

Rows become evidence, sums of products of `columns`, so that their number and order in the sums do not matter; time
enters through the contacts. The network, trained offline on simulated drives of every family and of none
(`tools/train_meta.py`), reads what simple beliefs make of the evidence and says how large each group of columns and the
noise will be; the branches and their covariance follow (physics.md eq. 19). Contacts and belief are found in turn.
After Harrison, Sharma, Pavone: Meta-learning priors for efficient online Bayesian regression, WAFR 2018.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import resources

import numpy as np
from threadpoolctl import ThreadpoolController

from printmend.machine.mechanism import Mechanism, Transmission, healthy_transmission
from printmend.measure.checks import check_trace
from printmend.path import Trace, frozen, last_way
from printmend.printer import Printer
from printmend.units import SIGMA_PER_MEDIAN
from printmend_lab.greybox.drive import Rows
from printmend_lab.greybox.greybox import motor_rows
from printmend_lab.greybox.model import cross_frame
from printmend_lab.meta import kernels
from printmend_lab.meta.bayes import believed, first_look, forward, membership, posterior
from printmend_lab.meta.columns import GROUPS, columns, groups
from printmend_lab.meta.tasks import evidence, reach_of
from printmend_lab.protocols import MachineLearned

BELIEF_PASSES = 4  # how often contacts are found under the belief, and the belief from the contacts
LOOKED_AT = 800  # measured rows that all passes but the last one use at most
CLEAR_MM = (3.0, 1.0, 0.3, 0.0)  # travel one way after which a belt surely touches: the first that leaves enough rows
ENOUGH_ROWS, ENOUGH_SHARE = 12, 0.3  # enough are this many measured rows, and this share of all
HUBER_SIGMAS, OUTLIER_SIGMAS = 2.5, 8.0  # standard deviations beyond which a row counts for less, and for nothing
SURE_SIGMAS = 2.0  # standard deviations that the frame's terms, and the play, must be away from 0 to be believed
AT_HOME_MM = 1e-6  # a first way-point this near to the home position is that position, but for rounding
_NEVER_MM = 1e-9  # standard deviation of the weights that the rows cannot show: they stay at 0
_CROSS, _PLAY = GROUPS.index("cross"), GROUPS.index("play")
CROSS_POWERS = ((0, 1), (0, 2), (1, 1), (2, 0), (0, 3))  # of this belt's place and of the other's, as in `columns`


@dataclass(frozen=True)
class Place:
    """Where a motor works: its turn, the bed's middle from which places count, and how far it goes about that [mm]."""

    turn_mm: float
    middle_mm: float
    reach_mm: tuple[float, float]


@dataclass(frozen=True, eq=False)
class MetaDrive:
    """What is believed of a motor: weights of the columns, ``mean`` [C] and ``covariance`` [C, C], and the noise."""

    place: Place
    mean: np.ndarray
    covariance: np.ndarray
    noise_mm: float

    def branches_mm(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (lower, upper) [mm] at motor positions [N] that rise."""
        return self.branches_of(motor_mm, self._columns(motor_mm, 1.0))

    def branches_of(self, motor_mm: np.ndarray, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Do so where the columns [N, C] of the upper branch are known."""
        playing = groups(self.place.reach_mm) >= _PLAY
        middle = motor_mm + whole @ np.where(playing, 0.0, self.mean)
        half = np.maximum(whole @ np.where(playing, self.mean, 0.0), 0.0)
        lower = np.maximum.accumulate(middle - half)
        return lower, np.maximum(np.maximum.accumulate(middle + half), lower)

    def sd_mm(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations (lower, upper) [mm] of the branches at motor positions [N]."""
        found = [self._columns(motor_mm, side) for side in (-1.0, 1.0)]
        lower, upper = (np.sqrt(_doubt(phi, self.covariance)) for phi in found)
        return lower, upper

    def _columns(self, motor_mm: np.ndarray, side: float) -> np.ndarray:
        return _drive_columns(self.place, motor_mm, side)


def _drive_columns(place: Place, motor_mm: np.ndarray, side: float) -> np.ndarray:
    """Return the columns [N, C] of a drive's branch; those of the frame are zero."""
    at = np.asarray(motor_mm, float) - place.middle_mm
    found = columns(at, np.full(len(at), side), np.zeros(len(at)), place.turn_mm, place.reach_mm)
    found[:, groups(place.reach_mm) == _CROSS] = 0.0
    return found


def _doubt(phi: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the variances [N] of what the columns [N, C] say."""
    return np.asarray(((phi @ covariance) * phi).sum(axis=1))


@dataclass(frozen=True, eq=False)
class MetaModel(MachineLearned):
    """A machine as ``meta`` learned it; ``mechanism`` gives positions in the frame of the measurement."""

    mechanism: Mechanism
    drives: tuple[MetaDrive, MetaDrive]

    @property
    def imagined(self) -> Mechanism:
        return self.mechanism


@dataclass(frozen=True, eq=False)
class _Rows:
    """A motor's rows: commanded, off by [NaN where unmeasured] and the other motor's place, from the bed's middle."""

    motor_mm: np.ndarray
    off_mm: np.ndarray
    other_mm: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class _Seen:
    """Rows [K] with a contact: where the motor touched, what was measured beyond, their weights, columns [K, C]."""

    touched_mm: np.ndarray
    residual_mm: np.ndarray
    weight: np.ndarray
    phi: np.ndarray


@dataclass(frozen=True)
class MetaLearner:
    """The learner ``meta``; without ``weights`` it uses those that come with printmend."""

    name: str = "meta"
    weights: Mapping[str, np.ndarray] | None = None

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MetaModel:
        """Learn from a trace. Raise `TraceError` as `check_trace` does."""
        check_trace(trace, printer)
        weights = shipped() if self.weights is None else self.weights
        with _libraries().limit(limits=1, user_api="blas"):
            rows = motor_rows(_with_home(trace, printer), printer)
            drives = [_drive(found, printer, k, weights, homed=trace.homed) for k, found in enumerate(rows)]
        x, y = (_table(drive, printer, k) for k, drive in enumerate(drives))
        terms = [drive.mean[groups(drive.place.reach_mm) == _CROSS] for drive in drives]
        frame = cross_frame(printer, [(CROSS_POWERS, values) for values in terms])
        return MetaModel(Mechanism(printer, (x, y), frame), (drives[0], drives[1]))


@cache
def _libraries() -> ThreadpoolController:
    """Return what holds the threads of the libraries for linear algebra, which takes a while to find them."""
    return ThreadpoolController()


@cache
def shipped() -> dict[str, np.ndarray]:
    """Return the weights that come with printmend (`tools/train_meta.py` makes them)."""
    from safetensors.numpy import load

    data = (resources.files("printmend_lab.meta") / "meta.safetensors").read_bytes()
    return {name: value.astype(float) for name, value in load(data).items()}


def _with_home(trace: Trace, printer: Printer) -> Trace:
    """Return the trace with its home position as measured: at home the end stops put the carriage there."""
    known = trace.measured_rows[0] or not (trace.homed and trace.placed)
    if known or np.abs(trace.commanded_mm[0] - printer.home_mm).max() > AT_HOME_MM:
        return trace
    measured = trace.measured_mm.copy()
    measured[0] = printer.home_mm
    return replace(trace, measured_mm=measured)


def _drive(
    found: Rows, printer: Printer, motor: int, weights: Mapping[str, np.ndarray], *, homed: bool
) -> MetaDrive:  # fmt: skip
    """Find contacts and belief in turn, on some rows of a long trace until the last time."""
    place = Place(found.period_mm, found.middle_mm[0], reach_of(printer, motor))
    rows = _Rows(found.motor_mm - place.middle_mm, found.measured_mm - found.motor_mm, found.other_mm, found.weight)
    known = np.flatnonzero(rows.weight > 0)
    some = np.zeros(len(rows.weight), bool)
    some[known[np.unique(np.linspace(0, len(known) - 1, LOOKED_AT).astype(int))]] = True
    at, side, weight = _guessed(rows)
    drive = _believe(_seen(rows, at, side, weight * some, place), place, weights)
    for number in range(1, BELIEF_PASSES):
        at, side = _touched(rows, drive, printer, motor, homed=homed)
        weight = np.where(at >= 0, rows.weight, 0.0)
        seen = _seen(rows, at, side, weight if number == BELIEF_PASSES - 1 else weight * some, place)
        drive = _believe(_robust(seen, drive), place, weights)
    return drive


def _guessed(rows: _Rows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return contacts (rows [N], sides [N]) where a motor that has gone some way touches; other rows weigh nothing."""
    step = np.diff(rows.motor_mm, prepend=rows.motor_mm[0])
    side = last_way(rows.motor_mm)
    begun = np.concatenate([[0.0], np.cumsum(np.abs(step))[:-1]])
    turned = np.concatenate([[True], side[1:] != side[:-1]])
    since = begun + np.abs(step) - np.maximum.accumulate(np.where(turned, begun, 0.0))
    total = rows.weight.sum()
    weight = rows.weight
    for clear_mm in CLEAR_MM:
        weight = np.where((since >= clear_mm) & (side != 0), rows.weight, 0.0)
        if (weight > 0).sum() >= ENOUGH_ROWS and weight.sum() >= ENOUGH_SHARE * total:
            break
    return np.arange(len(step)), -side, weight  # going forwards the lower branch pushes


def _seen(rows: _Rows, at: np.ndarray, side: np.ndarray, weight: np.ndarray, place: Place) -> _Seen:
    """Return the rows that weigh something, as columns and what was measured beyond their contacts."""
    used = np.flatnonzero(weight > 0)
    touched = rows.motor_mm[at[used]]
    # the belt stands where the contact left it, not where the motor is by now
    residual = rows.off_mm[used] + rows.motor_mm[used] - touched
    phi = columns(touched, side[used], rows.other_mm[used], place.turn_mm, place.reach_mm)
    return _Seen(touched, residual, weight[used], phi)


def _believe(seen: _Seen, place: Place, weights: Mapping[str, np.ndarray]) -> MetaDrive:
    """Return what the network and the evidence of the rows make of the drive."""
    found = evidence(seen.phi, seen.residual_mm, seen.weight, seen.touched_mm, place.turn_mm)
    group = groups(place.reach_mm)
    member = membership(group)
    features = first_look(np, found.gram, found.slope, np.float64(found.square), np.float64(found.count),
                          np.float64(found.seen), member)  # fmt: skip
    said = forward(np, weights, features)
    deviation, sigma = believed(np, said[:-1], member), float(np.exp(said[-1]))
    mean, covariance = posterior(np, found.gram, found.slope, deviation, sigma)
    silent = np.zeros(len(group), bool)
    for part in (group == _CROSS, group >= _PLAY):
        if not _is_sure(seen.phi[:, part], mean[part], covariance[np.ix_(part, part)]):
            silent |= part
    if silent.any():
        deviation = np.where(silent, _NEVER_MM, deviation)
        mean, covariance = posterior(np, found.gram, found.slope, deviation, sigma)
        mean = np.where(silent, 0.0, mean)
    return MetaDrive(place, mean, covariance, sigma)


def _is_sure(phi: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> bool:
    """Say whether what these columns do at the rows is more than its own doubt."""
    effect = phi @ mean
    return bool(np.sum(effect**2) > SURE_SIGMAS**2 * np.sum(_doubt(phi, covariance)))


def _touched(
    rows: _Rows, drive: MetaDrive, printer: Printer, motor: int, *, homed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Follow the rows through the believed play: contacts (rows [N], −1 before the first; sides [N])."""
    place, (full_mm, _) = drive.place, _whole(drive.place, printer, motor)
    lower, upper = _branches(drive, printer, motor)
    at, side = np.empty(len(rows.motor_mm), np.int64), np.empty(len(rows.motor_mm), np.int8)
    first = int(np.argmax(rows.weight > 0))
    here = slice(first, first + 1)
    phi = columns(rows.motor_mm[here], np.zeros(1), rows.other_mm[here], place.turn_mm, place.reach_mm)[0]
    framed = phi @ np.where(groups(place.reach_mm) == _CROSS, drive.mean, 0.0)
    start_mm = float(rows.motor_mm[first] + rows.off_mm[first] + place.middle_mm - framed)
    if homed:  # the end stop was met moving that way
        start_mm = -np.inf if printer.motor_home_direction(motor) > 0 else np.inf
    kernels.touches(
        np.ascontiguousarray(rows.motor_mm + place.middle_mm), full_mm[0], 1 / (full_mm[1] - full_mm[0]), lower, upper,
        start_mm, at, side,
    )  # fmt: skip
    return at, side.astype(float)


def _robust(seen: _Seen, drive: MetaDrive) -> _Seen:
    """Return the rows with less weight on those far off what was believed, and none on those very far off."""
    left = np.abs(seen.residual_mm - seen.phi @ drive.mean) * np.sqrt(seen.weight)
    scale = np.full(
        len(left), max(drive.noise_mm, SIGMA_PER_MEDIAN * float(np.median(left)) if len(left) else 0.0, 1e-4)
    )
    far = left > HUBER_SIGMAS * scale
    # where nothing was seen before, what is believed may be off by more than the measurement
    doubt = _doubt(seen.phi[far], drive.covariance) * seen.weight[far]
    scale[far] = np.sqrt(scale[far] ** 2 + doubt)
    share = np.where(
        left > OUTLIER_SIGMAS * scale, 0.0, np.minimum(1.0, HUBER_SIGMAS * scale / np.maximum(left, 1e-12))
    )
    return replace(seen, weight=seen.weight * share) if (share > 0).sum() >= ENOUGH_ROWS else seen


def _table(drive: MetaDrive, printer: Printer, motor: int) -> Transmission:
    """Return the drive's branches over the bed and one more bed on either side, straight between full steps."""
    healthy = healthy_transmission(printer, motor)
    at, whole = healthy.motor_mm, _whole(drive.place, printer, motor)[0]
    lower, upper = (at + np.interp(at, whole, one - whole) for one in _branches(drive, printer, motor))
    return Transmission(healthy.first_mm, healthy.pitch_mm, lower, upper)


def _branches(drive: MetaDrive, printer: Printer, motor: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (lower, upper) [mm] at the full steps of the drive's table."""
    return drive.branches_of(*_whole(drive.place, printer, motor))


@lru_cache(maxsize=2)
def _whole(place: Place, printer: Printer, motor: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the full steps [N] of a drive's table, mm, and the columns there [N, C]: the same for every look at it."""
    at = healthy_transmission(printer, motor).motor_mm[:: printer.axes[motor].microsteps]
    return frozen(at), frozen(_drive_columns(place, at, 1.0))


LEARNERS = {"meta": MetaLearner()}
