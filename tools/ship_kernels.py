"""Compile what learn, check, mend, planners and demonstrations need into the packages' folders `compiled`.

The wheel of printmend takes its folder along; that of printmend-lab does not.

    .venv/bin/python tools/ship_kernels.py

As many processes as there are cores share the work. What is there already and still fits its source is left alone; what
fits no longer is removed.
"""

import os
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

from native_kernels import emit, link

if TYPE_CHECKING:
    from printmend.shipped import Shipped

LEARNED = {"lightgbm": "gain-table", "lightgbm-axis": "gain-table", "meta": "pulley"}  # each on a world it can learn
Task = tuple[Callable[[str], None], str]


def main() -> None:
    """Fill the folder; print what each part of the work compiled, and the sum."""
    os.environ["PRINTMEND_NUMBA"] = "1"  # what the last library holds is made again
    work = tasks()
    made: list[tuple[str, str, list]] = []
    entries, seconds = 0, 0.0
    with tempfile.TemporaryDirectory(prefix="printmend-") as empty:
        os.environ["NUMBA_CACHE_DIR"] = empty  # read when a process imports numba
        objects = Path(empty) / "objects"
        objects.mkdir()
        with ProcessPoolExecutor(min(os.cpu_count() or 1, len(work)), get_context("spawn"), fill) as pool:
            for done in as_completed([pool.submit(do, each, objects) for each in work]):
                said, count, took_s, used, calls = done.result()
                print(f"{said}: {count} compiled in {took_s:.0f} s", flush=True)
                entries, seconds = entries + count, seconds + took_s
                for home, names in zip(homes(), used, strict=True):
                    home.used.update(names)
                made += calls
        for home in homes():
            home.folder.mkdir(exist_ok=True)
            package = home.folder.parent.name
            print(link([one for one in made if one[0].partition(".")[0] == package], objects, home.folder))
    print(f"{entries} compiled in {seconds:.0f} s")
    for home in homes():
        home.forget_others()
        size = sum(path.stat().st_size for path in home.folder.iterdir())
        print(f"{len(home.used)} in {home.folder}: {size / 1e6:.1f} MB")


def homes() -> tuple["Shipped", "Shipped"]:
    """Return where the kernels of each package go."""
    import printmend_lab  # noqa: F401 - its folder is found by its module
    from printmend.shipped import shipped

    return shipped("printmend"), shipped("printmend_lab")


def tasks() -> list[list[Task]]:
    """Return the work: what shares kernels stands together, for one process, and what takes longest comes first."""
    from printmend.mend.warm import STEPS
    from printmend_lab.control.registry import controller_names

    slow = {"optimal", "optimal-area"}
    return [
        *([(learn_or_mend, step) for step in STEPS if step.startswith(what)] for what in ("mend", "learn")),
        [(plan, name) for name in sorted(slow)],
        [(plan, name) for name in controller_names() if name not in slow],
        [
            *((learn, name) for name in LEARNED),
            *((complete, family) for family in ("ellipse", "fourier")),
            (print_and_play, "body and game"),
            (number_and_draw, "numbered lines and the studio"),
        ],
    ]


def fill() -> None:
    """Let a process keep what it compiles."""
    from printmend.native import recording
    from printmend.shipped import Shipped

    Shipped.fill = recording.on = True


def do(work: list[Task], objects: Path) -> tuple[str, int, float, list[set[str]], list]:
    """Do a part of the work; return its names, how much it compiled, in how many seconds, the files used, and what
    `emit` made of it."""
    from printmend.jit import compilations
    from printmend.native import recording

    entries, seconds = compilations.entries, compilations.seconds
    for what, name in work:
        what(name)
    said = ", ".join(name for _, name in work)
    modules = {key: module for home in homes() for key, module in home.modules.items()}
    calls = emit(recording.calls, modules, objects)
    used = [home.used for home in homes()]
    return said, compilations.entries - entries, compilations.seconds - seconds, used, calls


def learn_or_mend(step: str) -> None:
    """Take one step of `printmend warm`."""
    from printmend.mend.warm import take

    take(step)


def plan(name: str) -> None:
    """Let a controller plan once for every kind of tables, as tables of bodies and the tests do."""
    from printmend_lab.conformance.controllers import KINDS, START, TARGETS, faulty_model
    from printmend_lab.control.registry import controller

    for kind in KINDS:
        controller(name).plan(faulty_model(kind), TARGETS[:40], START)


def learn(name: str) -> None:
    """Learn in another way, and tabulate and run what was learned."""
    import numpy as np

    from printmend_lab.conformance.learners import START, LearnerCandidate
    from printmend_lab.control.check import tables_of

    model = LearnerCandidate(name).fitted(LEARNED[name])
    tables_of(model, START, 3)
    model.advance(model.start(START), np.array([[1, 0]]))


def complete(family: str) -> None:
    """Learn a pulley of which half a turn was seen."""
    import numpy as np

    from printmend.path import Trace
    from printmend.printer import read_printer
    from printmend.twin import Twin
    from printmend_lab.greybox import Greybox
    from printmend_lab.sampling import sample

    printer, rng = read_printer("ender5"), np.random.default_rng(0)
    ends = 100.0 + np.array([0.0, 20.0, 4.0, 18.0, 0.0])
    way = np.stack([np.interp(np.arange(400), np.arange(5) * 100.0, ends)] * 2, axis=1)
    Greybox().fit(Trace(way, Twin.of(sample(family, rng), printer).follow(way)), printer, rng=rng)


def print_and_play(_: str) -> None:
    """Make a body of G-code, unpack binary G-code, undo skipped teeth, play the paper's game."""
    import numpy as np

    from printmend.gcode.kernels.meatpack import unpack
    from printmend.printer import read_printer
    from printmend_lab.body.layers import body_of
    from printmend_lab.env import PrintVectorEnv, algorithm1_agent
    from printmend_lab.greybox.drive.kernels import cheapest_levels

    body_of(b"G90\nM83\nG1 X90 Y90 Z0.2 E1\n" + b"G2 X90 Y90 I20 J0 E5\n" * 3, read_printer("ender5"), name="circles")
    unpack(np.frombuffer(bytes(4), np.uint8), np.empty(16, np.uint8))
    cheapest_levels(np.zeros((2, 3, 3)), 14.0, np.zeros((2, 2), np.int64))
    env = PrintVectorEnv(2, ticks=40)
    observation, _info = env.reset(seed=0)
    env.step(algorithm1_agent(env)(observation))


def number_and_draw(_: str) -> None:
    """Write numbered lines and packed ones, draw a part, print on a crooked frame: what not every file needs."""
    import numpy as np

    from printmend.gcode.kernels import pack, renumber
    from printmend.printer import read_printer
    from printmend.studio.scene import as_printed, read_drawing
    from printmend.twin.gcode import print_gcode
    from printmend.twin.twin import Twin
    from printmend_lab.sampling import sample

    text, out, printer = np.frombuffer(b"N7 G1 X1\n", np.uint8), np.empty(99, np.uint8), read_printer("ender5")
    renumber(text, 0, len(text), np.zeros(2, np.int64), out)
    pack(text, True, out)
    fault = sample("frame", np.random.default_rng(0), "realistic")
    with tempfile.TemporaryDirectory(prefix="printmend-") as name:
        part = Path(name) / "part.gcode"
        part.write_text("G90\nM83\nG28\nG1 X90 Y90 Z0.2 F6000\nG1 X99 E1\nG2 X90 Y90 I20 J0 E5\n")
        as_printed(read_drawing(part, printer), fault.lower(printer))
        print_gcode(part, Twin.of(fault, printer))


if __name__ == "__main__":
    main()
