"""Is the length of the motors' turns found where the preset has another, and kept where it has not?

    .venv/bin/python benchmarks/bench_turn.py --seed 77 --draws 4

A printer with pulleys of so many teeth, which the preset says are of 20 (20.2 are steps a millimetre that were
calibrated; "20 +1%" ones that were calibrated wrongly, so that all lengths are off by 1 %), prints random points of the
bed and is learned from them. A line: preset, points, teeth, fault, the motors whose turn was found to 0.3 %, and the
root mean square by which the learned machine misses 2000 other points, the median and the worst of the draws. A round
pulley's turn shows in nothing, so not all can be found. Then idlers that turn once in so many mm, off their centre by
0.05, 0.1 and 0.2 mm, on X beside a pulley that is off its own by 0.1 mm or not: how often the pulley's turn was kept
and the idler's found to 3 %.
"""

import argparse
from dataclasses import replace

import numpy as np

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.infer.fit import Fit
from printmend.learn.learned import learn
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend.units import TURN_RAD
from printmend_lab.sampling import sample

TEETH = (16, 19, 20, 20.2, 21, 24)
TEETH_STEPS = (*((teeth, 1.0) for teeth in TEETH), (20, 1.01), (20, 0.99))  # and how far a commanded millimetre goes
FAULTS = {"eccentric by 0.06": (0.06, 0.0), "by 0.2, play 0.2": (0.2, 0.2), "pulley-play": None, "pulley-loose": None}
IDLERS_MM = (30.0, 31.4, 34.6, 37.9, 38.5, 39.5, 41.0, 41.5, 45.0, 50.0, 63.0)
IDLER_SIZES_MM, BESIDE_MM = (0.05, 0.1, 0.2), (0.0, 0.1)
IDLER_POINTS = 600
TOOTH_MM, NOISE_MM = 2.0, 0.03
FOUND_SHARE, IDLER_SHARE = 0.003, 0.03


def machine(fault: str, rng: np.random.Generator) -> Corruption:
    """Return a machine of a family, or one whose two pulleys are off their centres."""
    if (sizes := FAULTS[fault]) is None:
        return sample(fault, rng)  # type: ignore[arg-type]
    x, y = (
        Drive(pulley=EccentricBore(sizes[0], float(rng.uniform(0, TURN_RAD))), belt=Play(sizes[1])) for _ in range(2)
    )
    return Corruption((x, y))


def _found(fit: Fit, turn_mm: float) -> int:
    """Return how many motors are said to turn once in so many mm, or to have an idler that does: both move alike."""
    idlers = [(block.where, block.shape[0]) for block in fit.blocks if block.effect == "idler"]
    lengths = [*enumerate(fit.scene.turns_mm), *idlers]
    return len({motor for motor, each in lengths if abs(each / turn_mm - 1) < FOUND_SHARE})


def idlers(name: str, seed: int, draws: int) -> None:
    """Print a line for each length of an idler."""
    preset = read_printer(name)
    for length_mm in IDLERS_MM:
        for beside_mm in BESIDE_MM:
            found, missed_mm = 0, []
            for size_mm in IDLER_SIZES_MM:
                for draw in range(draws):
                    rng = np.random.default_rng([seed, round(10 * length_mm), round(100 * size_mm), draw])
                    phase = float(rng.uniform(0, TURN_RAD))
                    twin = Twin.of(Corruption((Drive(pulley=EccentricBore(beside_mm, phase)), Drive())), preset)
                    points, others = (
                        np.vstack([[preset.home_mm], rng.uniform(10, 200, (n, 2))]) for n in (IDLER_POINTS, 2000)
                    )

                    def printed(
                        at: np.ndarray, twin: Twin = twin, wave: tuple = (length_mm, size_mm, phase)
                    ) -> np.ndarray:
                        turn = (at[:, 0] - at[0, 0]) * (TURN_RAD / wave[0])
                        off = wave[1] * (np.sin(turn + wave[2]) - np.sin(wave[2]))
                        return twin.follow(at) + np.stack([off, np.zeros(len(at))], axis=1)

                    trace = Trace(points, printed(points) + rng.normal(0, NOISE_MM, points.shape), homed=True)
                    learned = learn(trace, preset)
                    assert learned.fit is not None
                    kept = learned.fit.scene.turns_mm[0] == preset.x.mm_per_turn
                    periods_mm = [block.shape[0] for block in learned.fit.blocks if block.effect == "idler"]
                    found += kept and any(abs(each / length_mm - 1) < IDLER_SHARE for each in periods_mm)
                    off = (Twin(learned.saved.mechanism).follow(others) - printed(others))[1:]
                    missed_mm.append(float(np.sqrt((off**2).sum(axis=1).mean())))
            beside = "beside 0.1" if beside_mm else "alone"
            print(
                f"{name:8} {IDLER_POINTS:6} idler of {length_mm:4} mm {beside:10} {found:3}/{len(missed_mm):<3} "
                f"{np.median(missed_mm):9.4f} {max(missed_mm):7.4f}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draws", type=int, default=4)
    options = parser.parse_args()
    print(f"{'preset':8} {'points':>6} {'teeth':>6} {'fault':18} {'found':>7} {'median mm':>9} {'worst':>7}")
    for name in ("ender3", "corexy"):
        preset = read_printer(name)
        for count in (300, 600, 2000):
            for teeth, steps in TEETH_STEPS:
                turn_mm = TOOTH_MM * teeth
                x, y = (replace(axis, mm_per_turn=turn_mm) for axis in (preset.x, preset.y))
                named = f"{teeth:5}" if steps == 1 else f"{teeth} {100 * steps - 100:+.0f}%"
                for fault in FAULTS:
                    right, missed_mm = 0, []
                    for draw in range(options.draws):
                        rng = np.random.default_rng([options.seed, count, round(10 * teeth), draw])
                        twin = Twin.of(machine(fault, rng), replace(preset, x=x, y=y))
                        points, others = (
                            np.vstack([[preset.home_mm], rng.uniform(10, 200, (n, 2))]) for n in (count, 2000)
                        )
                        noise = rng.normal(0, NOISE_MM, points.shape)

                        def printed(at: np.ndarray, twin: Twin = twin, steps: float = steps) -> np.ndarray:
                            return twin.follow(at[0] + (at - at[0]) * steps)

                        learned = learn(Trace(points, printed(points) + noise, homed=True), preset)
                        assert learned.fit is not None
                        right += _found(learned.fit, turn_mm / steps)
                        off = (Twin(learned.saved.mechanism).follow(others) - printed(others))[1:]
                        missed_mm.append(float(np.sqrt((off**2).sum(axis=1).mean())))
                    print(
                        f"{name:8} {count:6} {named:>6} {fault:18} {right:3}/{2 * options.draws:<3} "
                        f"{np.median(missed_mm):9.4f} {max(missed_mm):7.4f}",
                        flush=True,
                    )
    idlers("ender3", options.seed, options.draws)


if __name__ == "__main__":
    main()
