"""Write a prediction as a file: JSON for programs, one self-contained HTML page for people."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import printmend
from printmend.clock import span_words
from printmend.errors import InputError
from printmend.extras import require
from printmend.files import replacing
from printmend.mend.prediction import Prediction, doubt_mm
from printmend.messages import ENGLISH, Tell, say, say_count, tell_in, together
from printmend.model import SavedModel
from printmend.printer import Axis
from printmend.promise.predict import Promise
from printmend.promise.words import in_a_table

if TYPE_CHECKING:
    from printmend.draw.document import Block
    from printmend.report.part_view import PartView

_MOST_ROWS = 400  # most rows of the table; the drawing shows all layers


def check_report_name(path: Path | None) -> None:
    """Raise `InputError` for a report that is neither .html nor .json, before any work is done."""
    if path is not None and path.suffix.lower() not in (".html", ".htm", ".json"):
        raise InputError(path, wanted=say("report-html-json"), came=str(path), todo=say("change-name"))
    if path is not None and path.suffix.lower() != ".json":
        require(say("report-in", path.suffix), "matplotlib")


def write_report(
    path: Path, source: str, model: SavedModel, prediction: Prediction, *, output: Path | None = None,
    language: str = ENGLISH,
) -> None:  # fmt: skip
    """Write the prediction for ``source``; the suffix of ``path`` chooses the format. A page is in a language.

    A page shows the part before and after mending if ``output``, the mended file, is given.
    """
    check_report_name(path)
    if path.suffix.lower() == ".json":
        text = _json(source, model, prediction)
    else:
        from printmend.report.page import page

        tell = tell_in(language)
        text = page(Path(source).name, _blocks(source, model, prediction, output, tell), tell=tell, language=language)
    with replacing(path) as file:
        file.write(text)


def _json(source: str, model: SavedModel, prediction: Prediction) -> str:
    about = {"source": source, "program": printmend.__version__, "model": model.digest, "printer": model.printer.name}
    return json.dumps({**about, **prediction.json()}, indent=1) + "\n"


def _blocks(
    source: str, model: SavedModel, prediction: Prediction, output: Path | None, tell: Tell
) -> "Iterator[Block]":
    from printmend.draw.document import Items, Numbers, Strip, Words
    from printmend.report.part_view import look_at
    from printmend.report.pictures import layers_picture, part_picture

    name = Path(source).name
    view = None
    if output is not None and Path(source).is_file():
        shift_mm = prediction.shift_mm if prediction.of_shape else (0.0, 0.0)
        doubts_mm = doubt_mm(prediction.before), doubt_mm(prediction.after)
        view = look_at(Path(source), output, model.mechanism, shift_mm=shift_mm, doubt_mm=doubts_mm)
    yield Words("title", name)
    yield Strip(_numbers(prediction))
    yield Words("heading", say("report-before-printing"))
    yield Items(_before_printing(model, prediction, view))
    if view is not None:
        yield Words("heading", say("report-part"))
        yield part_picture(view, tell)
    yield Words("heading", say("report-expected"))
    yield Numbers("", part_rows(prediction))
    if len(prediction.layers) > 1:
        yield layers_picture(prediction.layers, name, tell)
    if prediction.gain_mm is not None:
        yield Words("heading", say("report-causes"))
        yield Numbers(say("budget-said", name), budget_rows(prediction.after))
    yield Words("heading", say("report-printer"))
    yield Words("text", model.printer.name)
    yield Items(model.findings)
    yield Numbers(say("report-all-layers"), _layer_rows(prediction), folded=True)
    if (more := len(prediction.layers) - _MOST_ROWS) > 0:
        yield Words("small", say_count("terminal-report-more-layers", more))
    yield Words("small", say("report-foot", model.digest, printmend.__version__))


def before_and_after(prediction: Prediction, of: str) -> tuple[str, str]:
    """Return a file's error before and after mending, and the words for it; ``of`` says whose error it is."""
    before, after = prediction.before, prediction.after
    value = say("from-to-mm", f"{before.rms_mm:.3f}", f"{after.rms_mm:.3f}")
    if not after.made_of:
        return value, say("number-error", of)
    return value, say("number-error-range", of, f"{after.rms_low_mm:.3f}", f"{after.rms_high_mm:.3f}")


def part_rows(prediction: Prediction) -> list[tuple[str, ...]]:
    """Return the table of a part's expected errors, its head first."""
    head = ("report-error", "report-rms", "report-range", "report-p95", "report-largest")
    rows: list[tuple[str, ...]] = [tuple(map(say, head))]
    names = (say("as-it-is"), say("mended"))
    for name, errors in zip(names, (prediction.before, prediction.after), strict=True):
        ranged = f"{errors.rms_low_mm:.3f}–{errors.rms_high_mm:.3f}" if errors.made_of else ""
        rows.append((name, f"{errors.rms_mm:.3f}", ranged, f"{errors.p95_mm:.3f}", f"{errors.max_mm:.3f}"))
    for name, height in zip(names, prediction.heights or (), strict=False):
        rows.append((say("in-height", name), f"{height.rms_mm:.3f}", "", "", f"{height.max_mm:.3f}"))
    return rows


def budget_rows(promise: Promise) -> list[tuple[str, ...]]:
    """Return the uncertainty budget of an expected error by the GUM (JCGM 100:2008) [mm], its head first.

    Each row is a cause, the largest first; one that rounds to 0 is left out.
    """
    made = [(name, f"{share:.4f}") for name, share in sorted(promise.made_of.items(), key=lambda item: -item[1])]
    return [
        (say("budget-cause"), say("budget-type"), say("budget-uncertainty")),
        *((*in_a_table(name), share) for name, share in made if float(share)),
        (say("budget-combined"), "", f"{promise.combined_mm:.4f}"),
        (say("budget-expanded"), "", f"{2 * promise.combined_mm:.4f}"),
        (say("budget-range"), "", f"{promise.rms_low_mm:.4f}–{promise.rms_high_mm:.4f}"),
    ]


def _numbers(prediction: Prediction) -> list[tuple[str, str]]:
    found = [before_and_after(prediction, say("number-this-part"))]
    if (duration := prediction.duration) is not None:
        found.append((span_words(duration.after_s), duration.words(mended=True)))
    if prediction.clamped_extruding or prediction.unknown or prediction.splines:
        return [*found, (say("number-read-on"), say("number-not-all"))]
    return [*found, (say("number-safe"), say("number-all-on-bed" if prediction.on_bed else "number-all-as-written"))]


def _before_printing(model: SavedModel, prediction: Prediction, view: "PartView | None") -> list[str]:
    """Return the sentences that an owner should read before printing."""
    found = [*prediction.advice, *prediction.warnings, *filter(None, [prediction.shift_words])]
    if view is not None:
        axes = (model.printer.x, model.printer.y)
        sent = zip(axes, view.low_mm, view.high_mm, strict=True)
        bed = ((axis, axis.min_mm, axis.max_mm) for axis in axes)
        found.append(say("report-reach", _reach(sent), _reach(bed)))
    found += prediction.moves_words()
    length = f"{prediction.length_mm / 1000:.1f}"
    found.append(say("report-length", length, say_count("so-many-layers", len(prediction.layers))))
    return found


def _reach(spans: Iterable[tuple[Axis, float, float]]) -> str:
    """Return words for the span [mm] along each axis."""
    reaches = (
        say("axis-reach", axis.name.upper(), f"{round(low, 1) + 0.0:.1f}", f"{high:.1f}") for axis, low, high in spans
    )
    return together(", ", reaches)


def _layer_rows(prediction: Prediction) -> list[tuple[str, ...]]:
    """Return the table of all layers, its head first."""
    rms, largest = say("report-rms"), say("report-largest")
    head = (
        say("layer-2"), "z [mm]", say("report-path"), say("value-of", say("as-it-is"), rms), largest,
        say("value-of", say("mended"), rms), largest,
    )  # fmt: skip
    return [head] + [
        (
            str(i + 1), f"{layer['z_mm']:g}", f"{layer['length_mm'] / 1000:.2f}", f"{layer['before_rms_mm']:.3f}",
            f"{layer['before_max_mm']:.3f}", f"{layer['after_rms_mm']:.3f}", f"{layer['after_max_mm']:.3f}",
        )
        for i, layer in enumerate(prediction.layers[:_MOST_ROWS])
    ]  # fmt: skip
