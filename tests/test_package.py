"""What `help(printmend)` shows works."""

import textwrap

import numpy as np

import printmend


def test_the_example_in_the_package_runs() -> None:
    assert printmend.__doc__ is not None
    lines = printmend.__doc__.splitlines()
    code = textwrap.dedent("\n".join(line for line in lines if line.startswith("    ") or not line.strip()))
    there = np.arange(200, 500)
    path = np.stack([np.concatenate([there, there[::-1]]), np.concatenate([there[::-1], there])], axis=1)
    names = {
        "commanded_mm": path * 0.2,
        "measured_mm": path * 0.2 * 1.01,
        "targets_steps": path[1:],
        "start_steps": path[0],
    }
    exec(code, names)  # noqa: S102 - our own docstring
    plan = names["plan"]
    assert plan.controls.shape == (len(path) - 1, 2)  # type: ignore[attr-defined]
    assert np.abs(plan.imagined_steps[1:] - path[1:]).max() < 1.0  # type: ignore[attr-defined]
