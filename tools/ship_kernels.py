"""Compile what learn, check, mend, planners and demonstrations need into src/printmend/compiled, for wheel or clone.

    .venv/bin/python tools/ship_kernels.py

What is there already and still fits its source is left alone; what fits no longer is removed.
"""

import os
import tempfile


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="printmend-") as empty:
        os.environ["NUMBA_CACHE_DIR"] = empty  # read when numba is imported
        from printmend.jit import compilations
        from printmend.repair.warm import warm
        from printmend.shipped import shipped

        shipped.fill = True
        warm(print)
        plan()
        learn_and_print()
        shipped.forget_others()
    entries, seconds = compilations.entries, compilations.seconds
    size = sum(path.stat().st_size for path in shipped.folder.iterdir())
    print(f"{entries} compiled in {seconds:.0f} s; {len(shipped.used)} in {shipped.folder}: {size / 1e6:.1f} MB")


def plan() -> None:
    """Let every controller plan once for every kind of tables, as tables of bodies and the tests do."""
    from printmend.conformance.controllers import KINDS, START, TARGETS, faulty_model
    from printmend.control.registry import controller, controller_names

    for name in controller_names():
        for kind in KINDS:
            controller(name).plan(faulty_model(kind), TARGETS[:40], START)
        print(f"plan: {name}")


def learn_and_print() -> None:
    """Learn in every way, make a body of G-code, print it, play the paper's game: what the demonstrations do."""
    import numpy as np

    from printmend.body.load import body_of
    from printmend.conformance.learners import START, LearnerCandidate
    from printmend.control.check import tables_of
    from printmend.corruption import sample
    from printmend.env import PrintVectorEnv, algorithm1_agent
    from printmend.gcode.kernels.meatpack import unpack
    from printmend.learn.drive.kernels.jumps import cheapest_levels
    from printmend.learn.greybox import Greybox
    from printmend.path import Trace
    from printmend.printer import read_printer
    from printmend.twin import Twin

    for name, world in (("lightgbm", "gain-table"), ("lightgbm-axis", "gain-table"), ("meta", "pulley")):
        model = LearnerCandidate(name).fitted(world)
        tables_of(model, START, 3)
        model.advance(model.start(START), np.array([[1, 0]]))
        print(f"learn: {name}")
    printer, rng = read_printer("ender5"), np.random.default_rng(0)
    cheapest_levels(np.zeros((2, 3, 3)), 14.0, np.zeros((2, 2), np.int64))  # skipped teeth
    for family in ("ellipse", "fourier"):  # outlines of which half a turn was seen
        ends = 100.0 + np.array([0.0, 20.0, 4.0, 18.0, 0.0])
        way = np.stack([np.interp(np.arange(400), np.arange(5) * 100.0, ends)] * 2, axis=1)
        Greybox().fit(Trace(way, Twin.of(sample(family, rng), printer).follow(way)), printer, rng=rng)
    body_of(b"G90\nM83\nG1 X90 Y90 Z0.2 E1\n" + b"G2 X90 Y90 I20 J0 E5\n" * 3, printer, name="circles")
    unpack(np.frombuffer(bytes(4), np.uint8), np.empty(16, np.uint8))  # binary G-code
    env = PrintVectorEnv(2, ticks=40)
    observation, _ = env.reset(seed=0)
    env.step(algorithm1_agent(env)(observation))
    print("body, game")


if __name__ == "__main__":
    main()
