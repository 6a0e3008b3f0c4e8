"""Are the grey box's standard deviations true? How often the true branches lie within two of them.

    .venv/bin/python benchmarks/bench_calibration.py --seed 7 --draws 4 --noise-mm 0.05

Each draw breaks a printer, prints the marks of the probe (``--trace probe``) or a layer of a random body that is
so many turns across (``--trace 1``), adds noise and learns. Then the learned lower and upper branches are compared with
the true ones at 400 places over what the motor passed, an offset between the two machines taken off: the share of
places within 2 σ (0.95 if σ is true), the median |error|/σ (0.67), and the root mean squares of error and σ in µm.
"""

import argparse
from dataclasses import replace

import numpy as np

from printmend.corruption import sample
from printmend.learn.greybox import Greybox
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.bench.drawn_body import drawn_body
from printmend_lab.published import layer_trace

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--noise-mm", type=float, default=0.05)
    parser.add_argument("--trace", default="probe")
    parser.add_argument("--printer", default="ender3")
    parser.add_argument("--family", action="append")
    options = parser.parse_args()
    printer = read_printer(options.printer)
    print(f"{'family':14} {'within 2 σ':>10} {'median':>7} {'error µm':>9} {'σ µm':>7}")
    for family in options.family or FAMILIES:
        errors, sds = [], []
        for draw in range(options.draws):
            rng = np.random.default_rng([options.seed, draw])
            twin = Twin.of(sample(family, rng), printer)
            assert isinstance(twin.mechanism, Mechanism)
            model = Greybox().fit(traced(twin, options.trace, options.noise_mm, rng), printer, rng=rng)
            for motor, drive in enumerate(model.drives):
                place = np.linspace(*drive.branches.reach_mm, PLACES)
                mine = np.stack(model.mechanism.transmissions[motor].branches_mm(place))
                truth = np.stack(twin.mechanism.transmissions[motor].branches_mm(place))
                off = mine - truth
                errors.append(off - np.median(off))
                sds.append(np.stack(drive.sd_mm(place)))
        error, sd = np.concatenate(errors).ravel(), np.maximum(np.concatenate(sds).ravel(), 1e-6)
        away = np.abs(error) / sd
        rms = [1000 * np.sqrt(np.mean(np.square(part))) for part in (error, sd)]
        print(f"{family:14} {np.mean(away < 2):10.3f} {np.median(away):7.2f} {rms[0]:9.1f} {rms[1]:7.1f}", flush=True)


if __name__ == "__main__":
    main()
