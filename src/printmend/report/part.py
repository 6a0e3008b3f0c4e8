"""The prediction as a file: JSON for programs, one self-contained HTML page for people."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import printmend
from printmend.clock import span_words
from printmend.errors import InputError
from printmend.extras import require
from printmend.files import replacing
from printmend.mend.prediction import Prediction
from printmend.messages import say
from printmend.model import SavedModel
from printmend.printer import Axis
from printmend.units import counted

if TYPE_CHECKING:
    from printmend.report.part_view import PartView

_MOST_ROWS = 400  # of the table; the drawing has them all
_SAME_S = 1.0  # a printing time that differs by less is the same


def check_report_name(path: Path | None) -> None:
    """Raise `InputError` for a report that is neither .html nor .json, before any work is done."""
    if path is not None and path.suffix.lower() not in (".html", ".htm", ".json"):
        raise InputError(path, wanted=say("report-html-json"), came=repr(path.suffix), todo=say("change-name"))
    if path is not None and path.suffix.lower() != ".json":
        require(f"a report in {path.suffix}", "matplotlib")


def write_report(
    path: Path, source: str, model: SavedModel, prediction: Prediction, *, output: Path | None = None
) -> None:
    """Write the prediction for ``source`` in the form that the name of ``path`` asks for.

    A page shows the part before and after where ``output``, the mended file, is at hand.
    """
    check_report_name(path)
    as_json = path.suffix.lower() == ".json"
    with replacing(path) as file:
        file.write(_json(source, model, prediction) if as_json else _page(source, model, prediction, output))


def _json(source: str, model: SavedModel, prediction: Prediction) -> str:
    about = {"source": source, "program": printmend.__version__, "model": model.digest, "printer": model.printer.name}
    return json.dumps({**about, **prediction.json()}, indent=1) + "\n"


def _page(source: str, model: SavedModel, prediction: Prediction, output: Path | None) -> str:
    from printmend.report import budget
    from printmend.report.page import page, picture, say, strip, table
    from printmend.report.part_view import look_at
    from printmend.report.pictures import layers_picture, part_picture

    name = Path(source).name
    view = None
    if output is not None and Path(source).is_file():
        shift_mm = prediction.shift_mm if prediction.of_shape else (0.0, 0.0)
        view = look_at(Path(source), output, model.mechanism, shift_mm=shift_mm)
    advice = "".join(f"<li>{say(each)}</li>" for each in _before_printing(model, prediction, view))
    body = strip(_numbers(prediction, view)) + f"<h2>Before you print</h2><ul>{advice}</ul>"
    if view is not None:
        body += f"<h2>The part</h2>{picture(part_picture(view))}"
    body += f"<h2>How far it is off</h2>{table(part_rows(prediction))}"
    if len(prediction.layers) > 1:
        body += picture(layers_picture(prediction.layers, name))
    if prediction.gain_mm is not None:
        body += f"<h2>What the expectation is made of</h2><p>{say(budget.SAID)}</p>"
        body += table(budget.budget_rows(prediction.after))
    findings = "".join(f"<li>{say(line)}</li>" for line in model.findings)
    body += f"<h2>The printer</h2><p>{say(model.printer.name)}</p><ul>{findings}</ul>{_layers(prediction)}"
    foot = f"model {model.digest}, printmend {printmend.__version__}. Predicted by the learned model, not measured."
    return page(name, f"{body}<p><small>{say(foot)}</small></p>")


def part_rows(prediction: Prediction) -> list[tuple[str, ...]]:
    """Return the table of a part's expected errors, its head first."""
    rows: list[tuple[str, ...]] = [
        ("distance from where it belongs [mm]", "typical", "nine of ten prints", "95 % of it within", "largest")
    ]
    for name, errors in (("as it is", prediction.before), ("mended", prediction.after)):
        ranged = f"{errors.rms_low_mm:.3f}–{errors.rms_high_mm:.3f}" if errors.made_of else ""
        rows.append((name, f"{errors.rms_mm:.3f}", ranged, f"{errors.p95_mm:.3f}", f"{errors.max_mm:.3f}"))
    for name, height in zip(("as it is", "mended"), prediction.heights or (), strict=False):
        rows.append((f"{name}, in height", f"{height.rms_mm:.3f}", "", "", f"{height.max_mm:.3f}"))
    return rows


def _numbers(prediction: Prediction, view: "PartView | None") -> list[tuple[str, str]]:
    before, after = prediction.before, prediction.after
    ranged = f" ({after.rms_low_mm:.3f}–{after.rms_high_mm:.3f} in nine of ten prints)" if after.made_of else ""
    found = [(f"{before.rms_mm:.3f} → {after.rms_mm:.3f} mm", f"typical error as it is → mended{ranged}")]
    if (duration := prediction.duration) is not None:
        longer_s = duration.after_s - duration.before_s
        more = "as long as before" if abs(longer_s) < _SAME_S else f"{span_words(longer_s)} of it for mending"
        found.append((span_words(duration.after_s), f"printing time, {more}, as {duration.limits.words}"))
    if prediction.clamped_extruding or prediction.unknown or prediction.splines:
        return [*found, ("look below", "not all of it stays on the bed, or is understood")]
    where = "stays on the bed" if prediction.on_bed else "is where the file says, some of it beyond the edge of the bed"
    return [*found, ("safe to print", f"all of it {where}, and every printing move is understood")]


def _before_printing(model: SavedModel, prediction: Prediction, view: "PartView | None") -> list[str]:
    """Return what an owner should know before printing, a sentence each."""
    said = []
    if view is not None:
        axes = (model.printer.x, model.printer.y)
        printed = zip(axes, prediction.printed_low_mm, prediction.printed_high_mm, strict=True)
        sent = zip(axes, view.low_mm, view.high_mm, strict=True)
        bed = " and ".join(f"{axis.name.upper()} from {axis.min_mm:g} to {axis.max_mm:g} mm" for axis in axes)
        said.append(
            f"It is printed over {_reach(printed)}; what the file commands goes over {_reach(sent)}. The bed has {bed}."
        )
    if prediction.clamped_extruding:
        said.append(
            f"{prediction.clamped_extruding} printing moves would leave the bed by up to {prediction.beyond_mm:.2f} mm "
            "and are held back at its edge: move the part away from there."
        )
    if prediction.stops:
        said.append(
            f"At {counted(prediction.stops, 'place')} the nozzle stops for a moment amid a line, while a belt turns "
            "back: a small seam may show there. A coarser --tolerance makes fewer."
        )
    moves = f"{counted(prediction.moves, 'move')} {'becomes' if prediction.moves == 1 else 'become'}"
    layers = counted(len(prediction.layers), "layer")
    said.append(
        f"{moves} {prediction.commands}, over {prediction.length_mm / 1000:.1f} m of printed path in {layers}; "
        "speeds, temperatures and plastic stay as they were."
    )
    if prediction.unknown:
        said.append(
            f"Left as written: {counted(prediction.unknown, 'printing move')}{prediction.where_unknown}, for words "
            "that cannot be read, or because the file does not say where the head is there."
        )
    if prediction.splines:
        said.append(
            f"Not corrected: {counted(prediction.splines, 'curve')} (G5), because the file does not say where such a "
            "curve begins, or lacks I J or P Q."
        )
    words = (*prediction.advice, *prediction.warnings, *filter(None, [prediction.shift_words]))
    advice = (f"{each[0].upper()}{each[1:].removesuffix('.')}." for each in words)
    return [*advice, *said]


def _reach(spans: Iterable[tuple[Axis, float, float]]) -> str:
    """Return between which places [mm] of its axes something lies."""
    return " and ".join(f"{axis.name.upper()} {round(low, 1) + 0.0:.1f} to {high:.1f} mm" for axis, low, high in spans)


def _layers(prediction: Prediction) -> str:
    """Return the table of all layers, folded."""
    from printmend.report.page import table

    head = ("layer", "z [mm]", "path [m]", "as it is, typical", "largest", "mended, typical", "largest")
    rows = [
        (
            str(i + 1), f"{layer['z_mm']:g}", f"{layer['length_mm'] / 1000:.2f}", f"{layer['before_rms_mm']:.3f}",
            f"{layer['before_max_mm']:.3f}", f"{layer['after_rms_mm']:.3f}", f"{layer['after_max_mm']:.3f}",
        )
        for i, layer in enumerate(prediction.layers[:_MOST_ROWS])
    ]  # fmt: skip
    more = len(prediction.layers) - _MOST_ROWS
    note = f"<p><small>and {more} more; --report FILE.json has them all</small></p>" if more > 0 else ""
    return f"<details><summary>All layers</summary>{table([head, *rows])}{note}</details>"
