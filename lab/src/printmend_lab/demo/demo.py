"""The paper's demonstration: break a printer, print one test layer, learn, plan every layer, print again."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption, corruption_toml
from printmend.extras import install_command, is_installed
from printmend.files import replacing
from printmend.metrics import rmse
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.bench.case import row
from printmend_lab.path import Body
from printmend_lab.published import layer_trace

ROWS = ("naive", "lightgbm", "lightgbm-axis", "greybox", "oracle")
NAMES = {
    "naive": "Naive",
    "lightgbm": "LightGBM",
    "lightgbm-axis": "LightGBM per axis",
    "greybox": "Grey box",
    "oracle": "Oracle",
}
SHOWN = "greybox"
HEADER = ("model", "RMSE steps", "RMSE mm", "learn s", "plan s")


def rows() -> tuple[str, ...]:
    """Return those of `ROWS` whose library is installed."""
    return tuple(name for name in ROWS if is_installed("lightgbm") or not name.startswith("lightgbm"))


def left_out() -> str:
    """Return what this installation leaves out, and the command that adds it; empty where nothing is."""
    parts = {"lightgbm": "the paper's learner", "matplotlib": "the pictures"}
    missing = [module for module in parts if not is_installed(module)]
    said = " and ".join(parts[module] for module in missing)
    return f"left out: {said}; {install_command(missing)} adds what they need" if missing else ""


@dataclass(frozen=True, eq=False)
class Attempt:
    """What one model made of the body: its errors over the layers that it had not seen, and each layer's print."""

    row: str
    rmse_steps: float
    rmse_mm: float
    learn_s: float
    plan_s: float
    printed_steps: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Demo:
    """The whole story: the body, what was broken, the layer that was learned from and every model's attempt."""

    body: Body
    printer: Printer
    corruption: Corruption
    attempts: tuple[Attempt, ...]


def run_demo(
    body: Body,
    corruption: Corruption,
    printer: Printer,
    *,
    seed: int,
    tick: Callable[[str], None] = lambda what: None,
) -> Demo:
    """Break ``printer``, print the body's training layer, and let each model of `rows` plan and print every layer.

    The errors are over the layers other than the training layer (over it, where it is the only one).
    """
    twin = Twin.of(corruption, printer)
    training = body.training_layer
    trace = layer_trace(training, twin.run(training.controls, training.start_steps), printer)
    tick("test layer printed")
    attempts = []
    for name in rows():
        chosen = row(name)
        begun = time.perf_counter()
        model = chosen.model(trace, printer, twin, np.random.default_rng(seed))
        learned = time.perf_counter()
        plans = []
        for layer in body.layers:
            plans.append(chosen.controller.plan(model, layer.nominal_steps[1:], layer.start_steps))
            tick(f"{NAMES[name]}: layer {layer.index + 1}")
        planned = time.perf_counter()
        printed = tuple(
            twin.run(plan.controls, layer.start_steps) for plan, layer in zip(plans, body.layers, strict=True)
        )
        judged = [i for i, layer in enumerate(body.layers) if layer is not training] or [0]
        targets = np.concatenate([body.layers[i].nominal_steps for i in judged])
        results = np.concatenate([printed[i] for i in judged])
        pitch_mm = np.array(printer.mm_per_step)
        error_mm = rmse(targets * pitch_mm, results * pitch_mm)
        attempts.append(Attempt(name, rmse(targets, results), error_mm, learned - begun, planned - learned, printed))
    return Demo(body, printer, corruption, tuple(attempts))


def ticks(body: Body) -> int:
    """Return how often `run_demo` and `write_demo` tick together."""
    return 1 + len(rows()) * len(body.layers) + (3 if is_installed("matplotlib") else 0)


def cells(attempt: Attempt) -> tuple[str, ...]:
    """Return an attempt as the table's texts, in the order of `HEADER`."""
    numbers = (attempt.rmse_steps, attempt.rmse_mm, attempt.learn_s, attempt.plan_s)
    return (NAMES[attempt.row], *(f"{number:.3f}" for number in numbers))


def title(demo: Demo) -> str:
    """Return what the table is about."""
    training = demo.body.training_layer
    return (
        f"{demo.body.name}: {len(demo.body.layers)} layers, {demo.body.transitions} steps; learned from layer "
        f"{training.index + 1} ({training.transitions} steps), judged on the others"
    )


def closing(demo: Demo, written: list[Path]) -> str:
    """Return the last lines: what was broken, what it came to, what was written, what to do next."""
    naive, mended = (next(one for one in demo.attempts if one.row == name) for name in ("naive", SHOWN))
    faults = ", ".join(
        f"{motor.upper()} {section}" + ("" if part.kind == section else f" {part.kind}")
        for motor, drive in zip(demo.printer.motors, demo.corruption.drives, strict=True)
        for section, part in vars(drive).items()
        if part is not None
    )
    faults = ", ".join(filter(None, (faults, *(cause.effect for cause in demo.corruption.causes))))
    faults = faults or ("nothing" if demo.corruption.frame is None else "the frame")
    drifting = [NAMES[one.row] for one in demo.attempts if one.rmse_mm > naive.rmse_mm]
    slack = any(drive.belt is not None for drive in demo.corruption.drives)
    return "\n".join(
        [
            f"broken: {faults}. RMS error: {naive.rmse_mm:.2f} mm as it is, "
            f"{mended.rmse_mm:.2f} mm mended ({NAMES[SHOWN]})",
            *(
                f"{name}, as published, has no memory: it mistakes slack for lost motion and drifts. To see it without "
                "slack, remove the belts from corruption.toml and give that file as --corruption"
                for name in drifting
                if slack
            ),
            *(f"written: {path}" for path in written),
            "next: your own body, printmend paper --body part.gcode; the paper's Table I, printmend bench table1 -h",
        ]
    )


def write_demo(demo: Demo, out: Path, *, tick: Callable[[str], None] = lambda what: None) -> list[Path]:
    """Write the pictures, where matplotlib is installed, and the corruption to ``out``; return what was written."""
    out.mkdir(parents=True, exist_ok=True)
    written = _write_pictures(demo, out, tick) if is_installed("matplotlib") else []
    with replacing(out / "corruption.toml") as text:
        text.write(corruption_toml(demo.corruption))
    return [*written, out / "corruption.toml"]


def _write_pictures(demo: Demo, out: Path, tick: Callable[[str], None]) -> list[Path]:
    """Write three pictures: all layers from above, from the side, and the error along the test layer."""
    from matplotlib.colors import Normalize

    from printmend.draw import comparison, draw_above, new_figure, save
    from printmend.draw.body import above_view
    from printmend_lab.draw import draw_axis_error, draw_solid, printed_layer, solid_view

    body, printer = demo.body, demo.printer
    attempts = {attempt.row: attempt for attempt in demo.attempts}
    wanted = [layer.nominal_steps.astype(float) for layer in body.layers]
    prints = {"wanted": wanted, "as it is": attempts["naive"].printed_steps, "mended": attempts[SHOWN].printed_steps}
    bodies = {
        name: [printed_layer(layer, steps, printer) for layer, steps in zip(body.layers, printed, strict=True)]
        for name, printed in prints.items()
    }
    worst_mm = np.concatenate([layer.error_mm for layer in bodies["as it is"]])
    colours = Normalize(0, max(float(np.percentile(worst_mm, 98)), printer.x.mm_per_step))
    titles = [
        "wanted",
        f"as it is: typically {attempts['naive'].rmse_mm:.2f} mm off",
        f"mended: typically {attempts[SHOWN].rmse_mm:.2f} mm off",
    ]
    written = []
    for file, draw, view in (("above.png", draw_above, above_view), ("solid.png", draw_solid, solid_view)):
        box = view([layer for layers in bodies.values() for layer in layers])
        pictures = [
            lambda axes, layers=layers, draw=draw, box=box: draw(axes, layers, colours=colours, view_mm=box)
            for layers in bodies.values()
        ]
        title = f"{body.name} on a broken {printer.name}"
        written.append(save(comparison(titles, pictures, title=title, colours=colours), out / file))
        tick(file)
    figure, axes = new_figure(2, width_in=6.0, height_in=4.0)
    training, printed = body.training_layer, attempts["naive"].printed_steps[body.layers.index(body.training_layer)]
    corner_mm = (printer.x.min_mm, printer.y.min_mm)
    for axis, name in enumerate("xy"):
        pitch_mm = printer.mm_per_step[axis]
        nominal_mm = corner_mm[axis] + training.nominal_steps[:, axis] * pitch_mm
        printed_mm = corner_mm[axis] + printed[:, axis] * pitch_mm
        draw_axis_error(axes[axis], nominal_mm, printed_mm, axis_name=name, mm_per_turn=printer.axes[axis].mm_per_turn)
    figure.suptitle("what the test layer shows")
    figure.subplots_adjust(left=0.07, right=0.98, top=0.9, bottom=0.14, wspace=0.2)
    written.append(save(figure, out / "test-layer.png"))
    tick("test-layer.png")
    return written
