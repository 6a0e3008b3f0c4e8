"""Each peer on an example of its own: a figure that its maker, its paper or its library gives, and ours.

    .venv/bin/python benchmarks/peers_own.py

Prints the table of docs/peers.md. Where the source gives an equation instead of a figure, the equation is evaluated
here apart from the peer's code (by scipy where it must be integrated).
"""

import itertools
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from printmend.corruption import Corruption, CrookedFrame, Drive, Play
from printmend.learn import fit
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.peers.classical import Table, fitted_table
from printmend_lab.peers.hysteresis import PrandtlIshlinskii, Shape, moved
from printmend_lab.peers.ilc import GAIN, iterate
from printmend_lab.peers.narx import picked
from printmend_lab.peers.network import fitted_network, inputs, remembered
from printmend_lab.peers.process import fitted_process, predicted
from printmend_lab.peers.rows import MotorRows

PRINTER = read_printer("ender5")


class Own(NamedTuple):
    """A figure of a peer's own example: the source's, and ours."""

    peer: str
    example: str
    theirs: float
    ours: float

    @property
    def off(self) -> float:
        """How far ours is off, as a share of theirs."""
        return abs(self.ours / self.theirs - 1)


def skew() -> Own:
    """Three lengths of a printed square, as Klipper and Marlin take them: AC 141.22, BD 141.15, AD 100 mm.

    Marlin's and Klipper's documents give the factor tan(π/2 − β) of the angle β between the sides (law of cosines).
    """
    diagonal, other, side = 141.22, 141.15, 100.0
    second = np.sqrt(2 * diagonal**2 + 2 * other**2 - 4 * side**2) / 2
    factor = np.tan(np.pi / 2 - np.arccos((diagonal**2 - second**2 - side**2) / (2 * second * side)))
    broken = Corruption(frame=CrookedFrame(float(np.degrees(np.arctan(-factor))), 1.0, 1.0, 0.0, 0.0))
    model = fit("affine", _square(broken), PRINTER, rng=np.random.default_rng(0))
    places = model.mechanism.bed.printed(np.array([[50.0, 50.0], [50.0, 150.0]]))  # type: ignore[attr-defined]
    return Own("affine", "Klipper SET_SKEW, Marlin XY_DIAG: AC 141.22, BD 141.15, AD 100", float(-factor),
               float(places[1, 0] - places[0, 0]) / 100)  # fmt: skip


def backlash() -> Own:
    """A machine that loses 0.3 mm at every turn of X: what Marlin's M425 X0.3 undoes."""
    model = fit(
        "backlash", _square(Corruption((Drive(belt=Play(0.3)), Drive()))), PRINTER, rng=np.random.default_rng(0)
    )
    table = model.mechanism.transmissions[0]  # type: ignore[attr-defined]
    return Own("backlash", "Marlin M425 X0.3 on a machine that loses 0.3 mm", 0.3,
               float((table.upper_mm - table.lower_mm).mean()))  # fmt: skip


def lead_screw() -> Own:
    """Beckhoff's example of a bilateral list (TF5200, kw.ssfk): at its third place −10.2 µm forwards, +8.0 µm back.

    Its places are stretched to ours. The difference of both ways there is compared.
    """
    places, forward, back = np.array([0.0, 20, 40]), np.array([0, 2.4, -10.2]), np.array([0, 6.7, 8.0])
    motor = np.concatenate([np.arange(0, 60, 0.5), np.arange(60, 0, -0.5)] * 3)  # beyond the last place its value holds
    way = np.sign(np.diff(motor, prepend=-0.5))
    error = np.where(way > 0, np.interp(motor, places, forward), np.interp(motor, places, back))
    drive = fitted_table(MotorRows(motor, error / 1000, np.zeros(len(motor), int)), Table(20.0, 0.0, True))
    lower, upper = drive(np.array([40.0]))
    return Own("bilateral", "Beckhoff TF5200, list with both ways: 18.2 µm between them at the third place", 18.2,
               float(upper[0] - lower[0]) * 1000)  # fmt: skip


def prandtl() -> Own:
    """Kuhnen's closed inverse: the operator after its inverse is the identity on any path."""
    rng = np.random.default_rng(0)
    operator = PrandtlIshlinskii(0.7, np.array([0.1, 0.3, 0.9]), np.array([0.2, 0.1, 0.25]))
    path = np.concatenate([[0.0], np.cumsum(rng.normal(0, 1, 400))])
    back = operator.run(operator.inverse().run(path))
    return Own("prandtl-ishlinskii", "Kuhnen 2003: operator after inverse, gain over a random path", 1.0,
               float((back @ path) / (path @ path)))  # fmt: skip


def bouc_wen() -> Own:
    """The equation with β 2 and γ 1 along a sine, integrated by scipy: the loop's area."""
    from scipy.integrate import solve_ivp

    t = np.linspace(0, 4 * np.pi, 4001)
    m = np.sin(t)

    def rate(at: float, z: np.ndarray) -> np.ndarray:
        dm = np.cos(at)
        return np.asarray(dm - 2.0 * abs(dm) * z - dm * np.abs(z))

    theirs = solve_ivp(rate, (0, t[-1]), [0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.01).y[0]
    ours = [np.zeros(1)]
    for a, b in itertools.pairwise(m):
        ours.append(moved(ours[-1], b - a, Shape(2.0, 1.0)))
    loop = slice(2001, None)
    areas = [float(np.trapezoid(z[loop], m[loop])) for z in (theirs, np.array(ours)[:, 0])]
    return Own("bouc-wen", "the equation of Rakotondrabe 2011 integrated by scipy: area of a closed loop", *areas)


def process() -> Own:
    """scikit-learn's regressor with a kernel of ours, by hand: what it predicts of a wave, RMS."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    motor = np.linspace(0, 80, 60)
    error = 0.4 * np.sin(2 * np.pi * motor / 40) + np.random.default_rng(0).normal(0, 0.02, 60)
    side, at = np.zeros(60), np.linspace(5, 75, 200)
    kernel = ConstantKernel(1.0) * RBF([1.0, 1.0, 3.0, 3.0]) + WhiteKernel(0.01)
    ours = predicted(fitted_process(MotorRows(motor, error, np.zeros(60, int)), side, kernel), at, np.zeros(200), 40.0)
    inputs = [np.stack([np.cos(a), np.sin(a), a / (2 * np.pi), 0 * a], axis=1) for a in
              (2 * np.pi * motor / 40, 2 * np.pi * at / 40)]  # fmt: skip
    plain = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True).fit(inputs[0], error - error.mean())
    theirs = plain.predict(inputs[1])
    return Own("gaussian-process", "scikit-learn's regressor called by hand: RMS of its prediction of a wave",
               float(np.sqrt((theirs**2).mean())), float(np.sqrt((ours**2).mean())))  # fmt: skip


def networks() -> Iterator[Own]:
    """scikit-learn's regressor by hand, on what a network reads of a belt with play: what it predicts there, RMS.

    Bai 2018 and Chua 2018 give figures of tasks of another kind: sequences of 600 steps, robots in MuJoCo.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor

    turns = np.abs(np.linspace(0, 4, 240) % 2 - 1) * 80
    behind = 0.2 * np.sign(np.gradient(turns))
    error = 0.4 * np.sin(2 * np.pi * turns / 40) - behind + np.random.default_rng(0).normal(0, 0.02, 240)
    rows = MotorRows(turns, error, np.zeros(240, int))
    memory = remembered(rows)
    read = inputs(memory, turns, rows.turn_mm)
    for name, members in (("tcn", 1), ("ensemble", 5)):
        ours = fitted_network(rows, memory, 1.0, members, seed=3)
        left, rng, total = error - ours.scale * turns, np.random.default_rng(3), np.zeros(240)
        size = (left - left.mean()).std()
        for member in range(members):
            seen = rng.integers(0, 240, 240) if members > 1 else np.arange(240)
            net = MLPRegressor(
                hidden_layer_sizes=(24, 24), activation="tanh", solver="lbfgs", alpha=1.0, max_iter=150,
                random_state=3 + member,
            )  # fmt: skip
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ConvergenceWarning)  # it ends after its updates
                net.fit(read[seen], (left - left.mean())[seen] / size)
            total += size * net.predict(read) / members
        found = ours.error_mm(memory, turns) - ours.scale * turns
        said = "regressor" if members == 1 else "regressors, five on drawn rows,"
        yield Own(name, f"scikit-learn's {said} called by hand: RMS of the prediction of a wave and a play",
                  *(float(np.sqrt((each**2).mean())) for each in (total, found)))  # fmt: skip


# What SysIdentPy 0.9.0's FROLS finds in these data (polynomials of degree 2, lags of 2, three terms), and how much of
# the variance each term explains.
SYSIDENTPY = {
    "x(k-2)": (0.90000, 0.957403742),
    "y(k-1)": (0.20001, 0.0392311187),
    "x(k-1)y(k-1)": (0.099999, 0.00336510169),
}


def narx() -> Iterator[Own]:
    """SysIdentPy's own example, y = 0.2 y(k-1) + 0.1 y(k-1) x(k-1) + 0.9 x(k-2) + noise, by our term selection."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-1, 1, 1000), np.zeros(1000)
    noise = rng.normal(0, 0.0001, 1000)
    for k in range(2, 1000):
        y[k] = 0.2 * y[k - 1] + 0.1 * y[k - 1] * x[k - 1] + 0.9 * x[k - 2] + noise[k]
    lags = {"y(k-1)": y[1:-1], "y(k-2)": y[:-2], "x(k-1)": x[1:-1], "x(k-2)": x[:-2]}
    terms = {"1": np.ones(998), **lags}
    terms |= {b + a: lags[a] * lags[b] for a, b in itertools.combinations_with_replacement(lags, 2)}
    weights = dict(zip(terms, picked(np.stack(list(terms.values()), axis=1), y[2:], 3), strict=True))
    for name, (theirs, _) in SYSIDENTPY.items():
        yield Own("narx", f"SysIdentPy 0.9.0, its example: weight of {name}", theirs, float(weights[name]))


def iterative() -> Own:
    """Bristow 2006: on a plant of gain g, learning with gain γ leaves 1 − γg of the error at each print."""
    targets = 1000.0 * np.stack([np.sin(np.linspace(0, 3, 900)), np.cos(np.linspace(0, 3, 900))], axis=1)

    def print_layer(controls: np.ndarray) -> np.ndarray:
        nominal = np.concatenate([targets[:1], targets[0] + np.cumsum(controls, axis=0)])
        return np.asarray(targets[0] + 0.8 * (nominal - targets[0]))

    errors = [attempt.rmse_steps for attempt in iterate(print_layer, targets, prints=3, c_max=60)]
    return Own("iterative learning", "Bristow 2006: error left by a print, of the one before, plant of gain 0.8",
               1 - GAIN * 0.8, errors[1] / errors[0])  # fmt: skip


def examples() -> list[Own]:
    """Return all examples."""
    return [skew(), backlash(), lead_screw(), prandtl(), bouc_wen(), process(), *networks(), *narx(), iterative()]


def _square(broken: Corruption) -> Trace:
    """Return what a printer prints that goes forth and back along both axes."""
    home = np.array(PRINTER.home_mm)
    corners = [(50, 50), (150, 50), (150, 150), (50, 150), (50, 50), (150, 150), (60, 140), (140, 60), (50, 50)]
    points = np.array([home, *corners], float)
    fine = np.concatenate([np.linspace(a, b, 80, endpoint=False) for a, b in itertools.pairwise(points)])
    twin = Twin.of(broken, PRINTER)
    assert isinstance(twin.mechanism, Mechanism)
    return Trace(fine, twin.follow(fine), homed=True)


def main() -> None:
    print("| row | its own example | theirs | ours | difference |")
    print("|---|---|---:|---:|---:|")
    for one in examples():
        print(f"| `{one.peer}` | {one.example} | {one.theirs:.5g} | {one.ours:.5g} | {100 * one.off:.2f} % |")


if __name__ == "__main__":
    main()
