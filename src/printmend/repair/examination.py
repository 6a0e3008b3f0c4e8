"""What is wrong with a printer, as a document for its owner: words, advice, pictures, and what it means for a part."""

import base64
import html
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import printmend
from printmend.diagnosis.advice import Advice, advise
from printmend.diagnosis.diagnosis import Diagnosis, Fault, diagnose, doubt_of
from printmend.diagnosis.portrait import Portrait, portrait
from printmend.errors import InputError
from printmend.files import replacing
from printmend.learn.greybox import GreyboxModel
from printmend.learn.hybrid import Hybrid
from printmend.path import Trace
from printmend.printer import Printer
from printmend.repair.learned import fit_beside_screw, greybox_model, left_over_mm, todo, told
from printmend.repair.mend import check_gcode
from printmend.repair.prediction import Prediction
from printmend.saved.model import SavedModel

SUFFIXES = (".html", ".htm", ".pdf")
MOST_ARROWS, MOST_POINTS = 1200, 3000
LEAST_ADVICE_MM = 0.01  # a fault that shifts a print by less is not worth a paragraph
URGENCY = {
    "repair": "Repair", "soon": "Look at it when convenient", "software": "Leave it to the software",
}  # fmt: skip
_STYLE = """
:root { --ink: #1c1917; --soft: #57534e; --line: #e7e5e4; --paper: #ffffff; --card: #fafaf9; }
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, "Segoe UI", Roboto, sans-serif; max-width: 1000px; margin: 0 auto;
  padding: 2.2em 1.4em; color: var(--ink); background: var(--paper); }
h1 { font-size: 1.9em; margin: 0 0 .2em; } h2 { margin: 2.2em 0 .6em; font-size: 1.3em; }
.big { font-size: 1.15em; margin: .3em 0 1.2em; } small { color: #78716c; }
.strip { display: grid; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); gap: .8em; margin: 1.2em 0; }
.strip div { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: .8em 1em; }
.strip b { display: block; font-size: 1.55em; line-height: 1.25; } .strip span { color: var(--soft); font-size: .9em; }
.fault { border: 1px solid var(--line); border-left: 7px solid #86868b; border-radius: 10px; background: var(--card);
  padding: .4em 1.2em .7em; margin: .9em 0; break-inside: avoid; }
.fault h3 { margin: .4em 0 .2em; font-size: 1.1em; } .fault p { margin: .3em 0; }
.tag { font-size: .72em; font-weight: 600; border-radius: 1em; padding: .2em .8em; margin-left: .5em; color: #fff;
  white-space: nowrap; vertical-align: .12em; }
.repair { border-left-color: #c2410c; } .soon { border-left-color: #ca8a04; } .software { border-left-color: #15803d; }
.repair .tag { background: #c2410c; } .soon .tag { background: #a16207; } .software .tag { background: #15803d; }
dt { font-weight: 600; color: var(--soft); } dd { margin: 0; }
dl { display: grid; grid-template-columns: 8.5em 1fr; gap: .2em 1em; margin: .5em 0; }
table { border-collapse: collapse; }
td, th { padding: .3em 1em; text-align: right; border-bottom: 1px solid var(--line); }
td:first-child, th:first-child { text-align: left; padding-left: 0; font-weight: 600; }
figure { margin: 1.2em 0; padding: 1em; border: 1px solid var(--line); border-radius: 10px; break-inside: avoid; }
figure img { width: 100%; height: auto; display: block; } figcaption { color: var(--soft); margin-bottom: .6em; }
@media (max-width: 600px) { dl { grid-template-columns: 1fr; } dd { margin-bottom: .5em; } }
"""


@dataclass(frozen=True, eq=False)
class Examination:
    """A trace's fit with all that its report shows; ``part`` and ``prediction`` where a part was given.

    ``finer`` is the number of faults too small to be shown, ``beyond`` says what was learned that no known fault makes.
    """

    model: GreyboxModel
    saved: SavedModel
    diagnosis: Diagnosis
    advice: tuple[Advice, ...]
    portraits: tuple[Portrait, Portrait]
    places_mm: np.ndarray
    before_mm: np.ndarray
    after_mm: np.ndarray
    part: str | None
    prediction: Prediction | None
    finer: int
    beyond: tuple[str, ...]

    @property
    def title(self) -> str:
        """What stands above it."""
        return "What is wrong with this printer" if self.advice else "This printer is healthy"

    @property
    def headline(self) -> str:
        """One sentence for people in a hurry."""
        before, after = self.model.residual_before_mm, self.model.residual_after_mm
        if not self.advice:
            return f"This printer is healthy: points lie {before:.3f} mm from where they belong, typically."
        repairs, soon = (sum(one.urgency == urgency for one in self.advice) for urgency in ("repair", "soon"))
        words = (f"{repairs} to repair" if repairs else "", f"{soon} to look at soon" if soon else "")
        todo = " and ".join(filter(None, words)) or "all of which the software carries"
        faults = f"{len(self.advice)} fault{'s' if len(self.advice) > 1 else ''}, {todo}"
        finer = f", and {self.finer} too small to matter" if self.finer else ""
        return (
            f"Points lie {before:.2f} mm from where they belong, typically; all but {after:.3f} mm is explained by "
            f"{faults}{finer}."
        )


def check_name(path: Path) -> None:
    """Raise `InputError` for a report that is neither .html nor .pdf, before any work is done."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(path, wanted="a report in .html or .pdf", came=repr(path.suffix), todo="change its name")


def examine(trace: Trace, printer: Printer, *, part: Path | None = None, rng: np.random.Generator) -> Examination:
    """Learn a machine from a trace and say all that is known of it; ``part`` is G-code whose error is predicted.

    Raises `TraceError` like `learn`, `GcodeError` or `ModelError` for a part that cannot be printed here.
    """
    fit, found = fit_beside_screw(trace, printer, lambda clean: Hybrid().fit(clean, printer, rng=rng), rng=rng)
    whole, trace = trace, trace if found is None else found.trace
    model, diagnosis = fit.box, diagnose(fit.box, doubt_of(trace))
    saved = greybox_model(model, trace, hybrid=fit if fit.findings else None)
    if found is not None and not found.is_silent:
        saved = told(saved, found, found.series, whole)
        model = replace(model, residual_before_mm=saved.document["trace"]["residual_before_mm"])
        summary = "; ".join(filter(None, (diagnosis.summary, found.sentence)))
        gaps = (*diagnosis.gaps, *found.gaps.values())
        lifted = tuple(Fault(**fault, words=found.sentence) for fault in found.faults)
        diagnosis = Diagnosis((*diagnosis.faults, *lifted), summary, gaps)
    corexy = printer.kinematics == "corexy"
    order = list(URGENCY)
    all_advice = [advise(fault, corexy=corexy) for fault in diagnosis.faults]
    advice = [one for one in all_advice if one.effect_mm >= LEAST_ADVICE_MM or one.urgency != "software"]
    advice.sort(key=lambda one: (order.index(one.urgency), -one.effect_mm))
    after = left_over_mm(model)
    shown = np.flatnonzero(trace.measured_rows & np.isfinite(after).all(axis=1))
    shown = shown[:: max(1, len(shown) // MOST_ARROWS)]
    return Examination(
        model, saved, diagnosis, tuple(advice), (portrait(model, 0, trace), portrait(model, 1, trace)),
        trace.commanded_mm[shown], (trace.measured_mm - trace.commanded_mm)[shown], after[shown],
        None if part is None else part.name, None if part is None else check_gcode(part, saved),
        len(all_advice) - len(advice), fit.findings,
    )  # fmt: skip


def write_examination(path: Path, examination: Examination) -> None:
    """Write the report as one self-contained HTML page or as a PDF, as the name of ``path`` asks."""
    check_name(path)
    if path.suffix.lower() == ".pdf":
        from printmend.draw.document import save_pdf, text_pages

        save_pdf([*text_pages(_paragraphs(examination)), *(figure for _, figure in _figures(examination))], path)
        return
    with replacing(path) as file:
        file.write(_page(examination))


def summary(examination: Examination) -> str:
    """Say it in a few lines for a terminal."""
    rows = [examination.headline]
    rows += [f"{URGENCY[one.urgency].lower()}: {one.title} ({one.sure})" for one in examination.advice]
    rows += list(examination.beyond)
    if examination.prediction is not None:
        rows.append(_part_said(examination.part or "", examination.prediction))
    return "\n".join(rows + [f"not told by this trace: {gap}" for gap in examination.diagnosis.gaps])


def _part_said(part: str, prediction: Prediction) -> str:
    before, after = prediction.before, prediction.after
    return (
        f"{part}: expected to be typically {before.rms_mm:.3f} mm (at worst {before.max_mm:.2f}) off as it is, "
        f"{after.rms_mm:.3f} (at worst {after.max_mm:.2f}) mended"
    )


def _figures(examination: Examination) -> list[tuple[str, Any]]:
    """Return captions and figures."""
    from printmend.draw import new_figure
    from printmend.draw.bed import draw_errors, draw_layer_errors
    from printmend.draw.drive import draw_fit, draw_hull, draw_play

    printer = examination.model.printer
    figures = []
    for one in examination.portraits:
        figure, axes = new_figure(3, width_in=3.6, height_in=3.4)
        thin = slice(None, None, max(1, len(one.point_side) // MOST_POINTS))
        level = one.level(one.motor_mm)
        points = (one.point_motor_mm, one.point_error_mm - one.level(one.point_motor_mm), one.point_side)
        points = (points[0][thin], points[1][thin], points[2][thin])
        band = 2 * np.hypot(one.sd_mm, one.noise_mm)
        draw_fit(axes[0], one.motor_mm, one.error_mm - level, band, points, name=one.name, mm_per_turn=one.period_mm)
        draw_hull(axes[1], one.outline_mm, radius_mm=one.radius_mm, name=one.name)
        draw_play(axes[2], one.motor_mm, one.play_mm, one.play_sd_mm, name=one.name)
        figure.subplots_adjust(left=0.065, right=0.985, top=0.88, bottom=0.15, wspace=0.25)
        caption = (
            f"{one.name}: a wave that repeats each turn of the motor is the pulley, the gap between the colours is the "
            "play. 95 of 100 measured points should lie in the bands."
            + (f" The straight part, {one.scale_percent:+.2f} %, is taken off." if one.scale_percent else "")
        )
        figures.append((caption, figure))
    figure, axes = new_figure(2, width_in=5.4, height_in=5.0)
    bed = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    for axis, errors, title in (
        (axes[0], examination.before_mm, "the test print as it came out"),
        (axes[1], examination.after_mm, "what the diagnosis does not explain"),
    ):
        draw_errors(axis, examination.places_mm, errors, bed_mm=bed, title=title)
    figure.subplots_adjust(left=0.06, right=0.985, top=0.92, bottom=0.11, wspace=0.18)
    figures.append(("Over the bed: arrows of one direction on the right would be a fault that was not found.", figure))
    if examination.prediction is not None and examination.prediction.layers:
        figure, axes = new_figure(1, width_in=10.8, height_in=3.2)
        layers = examination.prediction.layers
        draw_layer_errors(axes[0], *([layer[f"{w}_rms_mm"] for layer in layers] for w in ("before", "after")))
        figure.subplots_adjust(left=0.07, right=0.985, top=0.95, bottom=0.16)
        figures.append((f"{examination.part}, layer by layer, predicted.", figure))
    return figures


def _strip(examination: Examination) -> list[tuple[str, str]]:
    """Return the few numbers that matter, each with its words."""
    model = examination.model
    numbers = [
        (f"{model.residual_before_mm:.2f} mm", "how far the test print typically lies from where it belongs"),
        (f"{model.residual_after_mm:.3f} mm", "of that nobody can explain: it cannot be mended"),
    ]
    if (prediction := examination.prediction) is not None:
        before, after = prediction.before.rms_mm, prediction.after.rms_mm
        numbers.append((f"{before:.2f} → {after:.3f} mm", f"your part {examination.part}, as it is → mended"))
    return numbers


def _facts(examination: Examination) -> list[str]:
    model = examination.model
    return [
        f"{model.printer.name}, {model.measured} measured points, noise {model.noise_mm:.3f} mm a coordinate",
        f"in short: {'; '.join((examination.diagnosis.summary, *examination.beyond))}",
        "the model is a machine of pulleys, belts and a frame"
        + (", with tables learned for what none of these explains" if examination.beyond else ""),
        f"model {examination.saved.digest}, printmend {printmend.__version__}; learned, not looked at: check before "
        "you buy parts",
    ]


def _paragraphs(examination: Examination) -> list[tuple[str, str]]:
    rows = [("title", examination.title), ("text", examination.headline)]
    for one in examination.advice:
        rows += [
            ("heading", f"{one.title} – {URGENCY[one.urgency].lower()}"), ("text", one.meaning),
            ("text", f"How sure: {one.sure}."), ("text", f"To do: {one.repair}"), ("text", f"Software: {one.software}"),
        ]  # fmt: skip
    rows += [("text", one) for one in examination.beyond]
    if examination.prediction is not None:
        rows += [("heading", "Your part"), ("text", _part_said(examination.part or "", examination.prediction))]
    if examination.diagnosis.gaps:
        rows.append(("heading", "What this print could not tell"))
        rows += [("text", gap) for gap in (*examination.diagnosis.gaps, *todo(examination.diagnosis.gaps))]
    return rows + [("small", fact) for fact in _facts(examination)]


def _page(examination: Examination) -> str:
    from printmend.draw.document import svg

    def say(text: str) -> str:
        return re.sub(r"`(.+?)`", r"<code>\1</code>", html.escape(text))

    faults = "".join(
        f'<div class="fault {one.urgency}"><h3>{say(one.title)} <span class="tag">{URGENCY[one.urgency]}</span></h3>'
        f"<p>{say(one.meaning)}</p><dl><dt>How sure</dt><dd>{say(one.sure)}</dd>"
        f"<dt>To do</dt><dd>{say(one.repair)}</dd>"
        f"<dt>The software</dt><dd>{say(one.software)}</dd></dl></div>"
        for one in examination.advice
    )
    part = ""
    if (prediction := examination.prediction) is not None:
        rows = "".join(
            f"<tr><td>{name}</td><td>{e.rms_mm:.3f}</td><td>{e.p95_mm:.3f}</td><td>{e.max_mm:.3f}</td></tr>"
            for name, e in (("as it is", prediction.before), ("mended", prediction.after))
        )
        part = (
            f"<h2>Your part: {say(examination.part or '')}</h2><table><tr><th>predicted distance from the wanted path "
            f"[mm]</th><th>typical</th><th>95 % below</th><th>largest</th></tr>{rows}</table>"
        )
    beyond = "".join(
        f'<div class="fault software"><h3>{say(one)}</h3>'
        "<p>printmend carries it, as long as it stays as it is.</p></div>"
        for one in examination.beyond
    )
    gaps = "".join(f"<li>{say(gap)}</li>" for gap in examination.diagnosis.gaps)
    todos = "".join(f"<p>{say(line)}</p>" for line in todo(examination.diagnosis.gaps))
    gaps = f"<h2>What this print could not tell</h2><ul>{gaps}</ul>{todos}" if gaps else ""
    pictures = ""
    for caption, figure in _figures(examination):
        # as an image of its own: the names inside two inline drawings would clash
        data = base64.b64encode(svg(figure).encode()).decode()
        pictures += (
            f'<figure><figcaption>{say(caption)}</figcaption><img alt="{say(caption)}" '
            f'src="data:image/svg+xml;base64,{data}"></figure>'
        )
    strip = "".join(f"<div><b>{say(value)}</b><span>{say(about)}</span></div>" for value, about in _strip(examination))
    facts = "".join(f"<p><small>{say(fact)}</small></p>" for fact in _facts(examination))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{examination.title}</title><style>{_STYLE}</style></head><body>
<h1>{examination.title}</h1>
<p class="big">{say(examination.headline)}</p>
<div class="strip">{strip}</div>
<h2>{"What is wrong, and what to do" if examination.advice else "Nothing to do"}</h2>
{faults}{beyond}{part}{gaps}
<h2>How it looks</h2>
{pictures}
<h2>Small print</h2>{facts}
</body></html>
"""
