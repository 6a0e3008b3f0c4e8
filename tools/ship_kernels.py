"""Compile what learn, check, mend and the planners need into src/printmend/compiled, for the wheel or for this clone.

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


if __name__ == "__main__":
    main()
