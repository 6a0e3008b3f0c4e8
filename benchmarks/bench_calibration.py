"""Are the grey box's standard deviations true? How often the true branches lie within two of them.

    .venv/bin/python benchmarks/bench_calibration.py --seed 7 --draws 4 --noise-mm 0.05

Each draw breaks a printer, prints the marks of the probe (``--trace probe``) or a layer of a random body that is
so many turns across (``--trace 1``), adds noise and learns. Then the learned lower and upper branches are compared with
the true ones at 400 places over what the motor passed, an offset between the two machines taken off: the share of
places within 2 σ (0.95 if σ is true), the median |error|/σ (0.67), and the root mean squares of error and σ in µm.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.bench.case import drawn_body
from printmend_lab.greybox import Greybox
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

sys.path.insert(0, str(Path(__file__).parent))
from runner import options_of, rows_of

FAMILIES = ("play", "eccentric", "polygon", "fourier", "published", "pulley-play", "pulley-loose", "set-screw",
            "elastic", "friction", "smooth")  # fmt: skip
PLACES = 400


def traced(twin: Twin, kind: str, noise_mm: float, rng: np.random.Generator) -> Trace:
    printer: Printer = twin.printer
    if kind == "probe":
        plan = design_probe(printer)
        printed = twin.follow(plan.waypoints_mm)[plan.rows]
        return plan.trace(printed + rng.normal(0, noise_mm, printed.shape))
    layer = drawn_body(rng, printer, size_mm=float(kind) * printer.x.mm_per_turn).layers[0]
    trace = layer_trace(layer, twin.run(layer.controls, layer.start_steps), printer)
    return replace(trace, measured_mm=trace.measured_mm + rng.normal(0, noise_mm, trace.measured_mm.shape))


def off_and_sd(options: argparse.Namespace, case: tuple[str, int]) -> dict[str, list[float]]:
    """Return by how much the branches of one printer are wrong, and what the model says of that."""
    family, draw = case
    printer, rng = read_printer(options.printer), np.random.default_rng([options.seed, draw])
    twin = Twin.of(sample(family, rng), printer)
    assert isinstance(twin.mechanism, Mechanism)
    model = Greybox().fit(traced(twin, options.trace, options.noise_mm, rng), printer, rng=rng)
    errors, sds = [], []
    for motor, drive in enumerate(model.drives):
        place = np.linspace(*drive.branches.reach_mm, PLACES)
        off = np.stack(model.mechanism.transmissions[motor].branches_mm(place))
        off -= np.stack(twin.mechanism.transmissions[motor].branches_mm(place))
        errors.append(off - np.median(off))
        sds.append(np.stack(drive.sd_mm(place)))
    return {"off_mm": np.ravel(errors).tolist(), "sd_mm": np.ravel(sds).tolist()}


def main() -> None:
    options = options_of(__doc__, seed=7, draws=4, noise_mm=0.05, trace="probe", printer="ender3", family=FAMILIES)
    print(f"{'family':14} {'within 2 σ':>10} {'median':>7} {'error µm':>9} {'σ µm':>7}")
    for family in options.family:
        rows = [row for _, row in rows_of(off_and_sd, [(family, draw) for draw in range(options.draws)], options)]
        error, sd = (np.concatenate([row[name] for row in rows]) for name in ("off_mm", "sd_mm"))
        sd = np.maximum(sd, 1e-6)
        away = np.abs(error) / sd
        rms = [1000 * np.sqrt(np.mean(np.square(part))) for part in (error, sd)]
        print(f"{family:14} {np.mean(away < 2):10.3f} {np.median(away):7.2f} {rms[0]:9.1f} {rms[1]:7.1f}", flush=True)


if __name__ == "__main__":
    main()
