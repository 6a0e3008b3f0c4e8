"""Neural networks over where the motor is and where it was: a temporal convolution, and an ensemble.

S. Bai, J. Z. Kolter and V. Koltun, An empirical evaluation of generic convolutional and recurrent networks for sequence
modeling (2018): causal convolutions whose taps lie 1, 2, 4, … samples apart. Seen from its newest sample such a network
is a perceptron over taps of the past. That is what is trained here, in scikit-learn: the taps are what the motor did
over its last 0.2 to 6.4 mm of travel, so that the rate does not matter. `ENSEMBLE` is five of them on bootstrapped
rows, the model of PETS (K. Chua et al., NeurIPS 2018) where the noise is alike everywhere. Its particles need not be
sampled: what the networks read is the commanded past, which is known, so that they differ in the output alone and their
mean is the mean over trajectories.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.memory import MemoryModel, memory_model
from printmend_lab.peers.rows import MotorRows, chosen, least_squares

TAPS_MM = 0.2 * 2.0 ** np.arange(6)  # of travel before now
_GRID_MM = 0.2  # of travel between the places that are remembered
_REMEMBERED = round(TAPS_MM[-1] / _GRID_MM)
_HARMONICS = 4  # of the motor's turn among the inputs
_PLACE_WAVES, _LONGEST_MM = 8, 240.0  # of the place: what does not come again each turn
_WIDTHS, _UPDATES, _MOST_ROWS = (24, 24), 150, 500
_DECAYS = (1.0, 0.03)  # of the weights, from smooth to bent
_LEAST_MM = 1e-6  # of spread, below which there is nothing to learn
Layers = tuple[tuple[np.ndarray, np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class Network:
    """One motor: ``scale``·m, and the mean of networks over `inputs`, times ``size_mm``.

    The memory is where the motor was [_REMEMBERED] after each 0.2 mm of travel before now.
    """

    scale: float
    size_mm: float
    turn_mm: float
    networks: tuple[Layers, ...]

    def start(self, motor_mm: float) -> np.ndarray:
        """Return the memory [S] of a motor that rested."""
        return np.full(_REMEMBERED, motor_mm)

    def step(self, memory: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray) -> np.ndarray:
        """Return the memory [K, S] after straight moves [K]."""
        ago = _GRID_MM * np.arange(1, _REMEMBERED + 1)
        far = np.abs(to_mm - from_mm)[:, None]
        past = np.concatenate([from_mm[:, None], memory], axis=1)
        at = np.maximum(ago - far, 0.0) / _GRID_MM
        low = np.minimum(at.astype(int), _REMEMBERED - 1)
        rows, share = np.arange(len(far))[:, None], at - low
        older = past[rows, low] * (1 - share) + past[rows, low + 1] * share
        fresh = to_mm[:, None] - np.sign(to_mm - from_mm)[:, None] * ago
        return np.where(far == 0, memory, np.where(ago <= far, fresh, older))

    def error_mm(self, memory: np.ndarray, motor_mm: np.ndarray) -> np.ndarray:
        """Return u − m [K] mm."""
        total = self.scale * motor_mm
        asked = inputs(memory, motor_mm, self.turn_mm)
        for layers in self.networks:
            total = total + self.size_mm / len(self.networks) * _forward(layers, asked)
        return np.asarray(total)


def inputs(memory: np.ndarray, motor_mm: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return the inputs [K, F]: waves of the turn and the place, how far the motor came in each tap's travel."""
    rates = np.concatenate([np.arange(1, _HARMONICS + 1) / turn_mm, np.arange(1, _PLACE_WAVES + 1) / _LONGEST_MM])
    angle = 2 * np.pi * motor_mm[:, None] * rates
    came = (motor_mm[:, None] - memory[:, np.rint(TAPS_MM / _GRID_MM).astype(int) - 1]) / TAPS_MM
    return np.concatenate([motor_mm[:, None] / 100.0 - 1.0, np.cos(angle), np.sin(angle), came], axis=1)


def _forward(layers: Layers, rows: np.ndarray) -> np.ndarray:
    """Return the output [K]; summed without BLAS, so that a batch says what its rows say."""
    for weight, offset in layers[:-1]:
        rows = np.tanh((rows[:, :, None] * weight).sum(axis=1) + offset)
    weight, offset = layers[-1]
    return np.asarray((rows * weight[:, 0]).sum(axis=1) + offset[0])


def remembered(rows: MotorRows) -> np.ndarray:
    """Return the memory [N, S] along the rows' path."""
    out, ago = np.empty((len(rows.layer), _REMEMBERED)), _GRID_MM * np.arange(1, _REMEMBERED + 1)
    for path in rows.paths():
        motor = rows.motor_mm[path]
        gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor)))])
        before_mm = gone[:, None] - ago
        engaged = 0 if path.start else rows.engaged
        out[path] = np.interp(before_mm, gone, motor) + engaged * np.minimum(before_mm, 0.0)
    return out


def fitted_network(rows: MotorRows, memory: np.ndarray, decay: float | None, members: int, seed: int) -> Network:
    """Fit networks of a weight decay to rows whose memory [N, S] is known; none but a scale for None."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor

    scale = max(float(least_squares(rows, rows.motor_mm[:, None])[0]), -0.9)
    left = rows.centred((rows.error_mm - scale * rows.motor_mm)[:, None])[:, 0]
    size, known, rng = float(left.std()), np.flatnonzero(rows.known), np.random.default_rng(seed)
    if decay is None or size < _LEAST_MM:
        return Network(scale, 0.0, rows.turn_mm, ())
    asked = inputs(memory[known], rows.motor_mm[known], rows.turn_mm)
    networks = []
    for member in range(members):
        seen = np.unique(np.linspace(0, len(known) - 1, _MOST_ROWS).astype(int))
        if members > 1:
            seen = rng.integers(0, len(known), len(seen))
        model = MLPRegressor(
            hidden_layer_sizes=_WIDTHS, activation="tanh", solver="lbfgs", alpha=decay, max_iter=_UPDATES,
            random_state=seed + member,
        )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # it ends after its updates
            model.fit(asked[seen], left[seen] / size)
        networks.append(tuple(zip(model.coefs_, model.intercepts_, strict=True)))
    return Network(scale, size, rows.turn_mm, tuple(networks))


@dataclass(frozen=True)
class NetworkLearner:
    """Networks for each motor, and the skew; held-out blocks choose the decay, or that a scale is all."""

    name: str
    members: int = 1

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MemoryModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        seed = int(rng.integers(2**31 - self.members))

        def element(rows: MotorRows) -> Network:
            memory = remembered(rows)

            def fit(some: MotorRows, decay: float | None) -> np.ndarray:
                return fitted_network(some, memory, decay, 1, seed).error_mm(memory, rows.motor_mm)

            decay = chosen(rows, (None, *_DECAYS), fit)
            return fitted_network(rows, memory, decay, self.members, seed)

        return memory_model(trace, printer, element)


# Rows by place, `printmend_lab.peers.network:TCN`: Algorithm 1 stands still on them where play swallows a step, which a
# registered learner's planner must not. `printmend_lab.peers.inverse:INVERSE` plans with them.
TCN, ENSEMBLE = NetworkLearner("tcn"), NetworkLearner("ensemble", 5)
