"""What is wrong with a printer, as a document for its owner: words, advice, pictures; a page in HTML, or a PDF."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import printmend
from printmend.diagnosis.advice import LEAST_ADVICE_MM, URGENCY, WORK, Advice, advised
from printmend.diagnosis.portrait import Circle, Portrait, Positioning, circle, contacts_of_fit, portrait, positioning
from printmend.draw import new_figure
from printmend.draw.document import Block, Card, Items, Numbers, Pictures, Strip, Words
from printmend.draw.figure import (
    INK,
    LEAST_UNROUND_MM,
    draw_circle_test,
    draw_coloured,
    draw_errors,
    draw_fit,
    draw_hull,
    draw_layer_errors,
    draw_play,
)
from printmend.errors import InputError
from printmend.files import replacing
from printmend.infer.fit import Fit
from printmend.learn.learned import learn, scatter_words, todo
from printmend.mend.filament import filament_of, grown, settled
from printmend.mend.mend import check_gcode, is_healthy
from printmend.mend.prediction import Prediction
from printmend.mend.verify import expectation
from printmend.messages import ENGLISH, Tell, is_one_of, say, tell_in, together
from printmend.model import SavedModel
from printmend.model.model import NOTE, REFUSAL, misfit_words
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.belief import parse_belief
from printmend.promise.predict import Promise
from printmend.promise.words import scale_words
from printmend.report.part import before_and_after, budget_rows, part_rows
from printmend.report.part_view import DrawnLayer, PartView

SUFFIXES = (".html", ".htm", ".pdf")
MOST_ARROWS = 1200  # in a picture
AFTER_WORK = say("after-work")


@dataclass(frozen=True, eq=False)
class Examination:
    """A trace's fit with all that its report shows; ``part`` and ``prediction`` where a part was given.

    ``finer`` is the number of faults too small to show. ``misfit`` holds the findings that the model does not fit.
    ``expected`` is the promise for a mended copy of the test print.
    """

    saved: SavedModel
    advice: tuple[Advice, ...]
    portraits: tuple[Portrait, Portrait]
    axes: tuple[Positioning, Positioning]
    circle: Circle
    places_mm: np.ndarray
    before_mm: np.ndarray
    after_mm: np.ndarray
    part: str | None
    prediction: Prediction | None
    finer: int
    misfit: tuple[str, ...]
    expected: Promise | None

    @property
    def title(self) -> str:
        """What stands above it."""
        return say("title-healthy" if self.is_healthy else "title-wrong")

    @property
    def is_healthy(self) -> bool:
        """Whether there is nothing to do. Notes concern the measurement, such as a plate that lay shifted."""
        return not (self.advice or any(not is_one_of(each, [NOTE]) for each in self.misfit))

    @property
    def refused(self) -> tuple[str, ...]:
        """The refusals: why this measurement mends nothing. They come before all findings."""
        return tuple(each for each in self.misfit if is_one_of(each, [REFUSAL]))

    @property
    def doubted(self) -> tuple[str, ...]:
        """The other findings that the model does not fit."""
        return tuple(each for each in self.misfit if each not in self.refused)

    @property
    def gaps(self) -> tuple[str, ...]:
        """What the trace did not show, a sentence each."""
        return self.saved.findings[1:]

    @property
    def before_rms_mm(self) -> float:
        """RMS error of the test print's points [mm]."""
        return float(self.saved.document["trace"]["residual_before_mm"])

    @property
    def after_rms_mm(self) -> float:
        """RMS of the unexplained part [mm]."""
        return float(self.saved.document["trace"]["residual_after_mm"])

    @property
    def headline(self) -> str:
        """One sentence for people in a hurry."""
        before, after = self.before_rms_mm, self.after_rms_mm
        if not self.advice:
            words = say("headline-healthy" if self.is_healthy else "headline-no-fault", f"{before:.3f}")
            return together(" ", [words, say("faults-too-small", self.finer)]) if self.finer else words
        counts = {urgency: sum(one.urgency == urgency for one in self.advice) for urgency in URGENCY}
        found = together(", ", [say(f"so-many-{urgency}", count) for urgency, count in counts.items() if count])
        words = say("headline-faults", f"{before:.2f}", len(self.advice), found, f"{after:.3f}")
        return together(" ", [words, say("more-too-small", self.finer)]) if self.finer else words


def check_name(path: Path) -> None:
    """Raise `InputError` for a report that is neither .html nor .pdf, before any work is done."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(path, wanted=say("report-html-pdf"), came=repr(path.suffix), todo=say("change-name"))


def examine(
    trace: Trace, printer: Printer, *, part: Path | None = None, filament: str | None = None, rng: np.random.Generator
) -> Examination:
    """Learn a machine from a trace and gather everything that its report shows. ``part`` is G-code whose error is
    predicted, ``filament`` the material of the measured part.

    Raises `TraceError` like `learn`, `GcodeError` or `ModelError` for a part that cannot be printed here.
    """
    filament = filament_of(trace, filament)
    learned = learn(grown(trace, printer, filament), printer, rng=rng)
    saved, flat, fit = settled(learned.saved, filament), learned.trace, learned.fit
    assert fit is not None  # the search is never without
    order = list(URGENCY)
    found = advised(saved.document)
    advice = [one for _, one in found if one.effect_mm >= LEAST_ADVICE_MM or one.urgency in WORK]
    advice.sort(key=lambda one: (order.index(one.urgency), -one.effect_mm))
    after = fit.left_by_mark_mm(flat)
    shown = np.flatnonzero(flat.measured_rows & np.isfinite(after).all(axis=1))
    shown = shown[:: max(1, len(shown) // MOST_ARROWS)]
    mechanism = saved.mechanism
    return Examination(
        saved, tuple(advice), (_portrait(saved, fit, 0), _portrait(saved, fit, 1)),
        (positioning(mechanism, 0), positioning(mechanism, 1)), circle(mechanism),
        flat.commanded_mm[shown], (flat.measured_mm - flat.commanded_mm)[shown], after[shown],
        None if part is None else part.name, None if part is None else check_gcode(part, saved),
        sum(one not in advice and row["kind"] != "offset" for row, one in found),
        (*scale_words(saved), *misfit_words(saved.document)), expectation(saved, flat),
    )  # fmt: skip


def _portrait(saved: SavedModel, fit: Fit, motor: int) -> Portrait:
    belief = parse_belief(saved)
    assert belief is not None
    return portrait(belief.parts, fit.scene, motor, contacts_of_fit(fit, motor), saved.noise_mm)


def summary(examination: Examination) -> str:
    """Say it in a few lines for a terminal."""
    rows = [examination.headline, *examination.refused]
    rows += [say("urgent-fault", URGENCY[one.urgency], one.title, one.sure) for one in examination.advice]
    if any(one.urgency in WORK for one in examination.advice):
        rows.append(AFTER_WORK)
    rows += examination.doubted
    if examination.prediction is not None:
        rows.append(part_said(examination.part or "", examination.prediction))
    return together("\n", rows + [say("not-shown-by-trace", gap) for gap in examination.gaps])


def part_said(part: str, prediction: Prediction) -> str:
    """Say in a line how far a part is expected to be off."""
    before, after = prediction.before, prediction.after
    sizes = (f"{size:.3f}" for size in (before.rms_mm, before.max_mm, after.rms_mm, after.max_mm))
    return say("part-expected", part, *sizes)


def numbers(examination: Examination) -> list[tuple[str, str]]:
    """Return the few numbers that matter, each with its words: the expected error after mending comes first."""
    found: list[tuple[str, str]] = []
    if (prediction := examination.prediction) is not None:
        found.append(before_and_after(prediction, say("number-your-part", examination.part or "")))
    return [
        *found,
        (say("mm-2", f"{examination.before_rms_mm:.3f}"), say("number-test-print")),
        (
            say("mm-2", f"{examination.after_rms_mm:.3f}"),
            say("number-unexplained", scatter_words(examination.saved)),
        ),
    ]


def standard_rows(examination: Examination) -> list[tuple[str, ...]]:
    """Return the table of the metrologist's names and the owner's words, its head first [mm]."""
    x, y = examination.axes
    run = examination.circle

    def row(name: str, *sizes: float) -> tuple[str, ...]:
        values = (f"{size:.3f}" for size in sizes)
        return (say(f"standard-{name}"), say(f"words-{name}"), *values, *[""] * (2 - len(sizes)))

    return [
        (say("standard-name"), say("standard-words"), "X", "Y"),
        row("reversal", x.reversal_mm, y.reversal_mm),
        row("mean-reversal", x.mean_reversal_mm, y.mean_reversal_mm),
        row("systematic", x.systematic_mm, y.systematic_mm),
        row("mean", x.mean_mm, y.mean_mm),
        row("circular", *run.circular_mm),
        row("both-circular", run.both_mm),
        row("radial", run.mean_mm),
    ]


def facts(examination: Examination) -> list[str]:
    """Return where the report comes from."""
    saved = examination.saved
    return [
        say("fact-measured", saved.printer.name, saved.document["trace"]["measured"], f"{saved.noise_mm:.3f}"),
        say("fact-in-short", saved.findings[0]),
        say("fact-model", saved.digest, printmend.__version__),
    ]


def closing(examination: Examination) -> tuple[str, ...]:
    """Return what the trace did not show, and which print would show it."""
    return (*examination.gaps, *todo(examination.gaps))


# The pictures of a report: drawings side by side, under one caption.

MOST_POINTS = 3000  # of a curve
_EVEN_MM = 0.02  # play that varies less along the axis is stated as a number
_FINEST_MM = 0.005  # half of the colours are for errors of at least this


def pictures(examination: Examination, tell: Tell) -> list[Pictures]:
    """Return what was measured and learned: drawings of each motor, and of the bed."""
    return [*(_motor(one, tell) for one in examination.portraits), _bed(examination, tell)]


def layers_picture(layers: Sequence[dict[str, float]], part: str, tell: Tell) -> Pictures:
    """Return the drawing of a part's expected error over its layers."""
    figure, axes = new_figure(1, width_in=7.0, height_in=2.6)
    draw_layer_errors(
        axes[0], *([layer[f"{which}_rms_mm"] for layer in layers] for which in ("before", "after")), tell=tell
    )
    figure.subplots_adjust(left=0.1, right=0.985, top=0.95, bottom=0.2)
    return Pictures([figure], say("picture-layers", part))


def part_picture(view: PartView, tell: Tell) -> Pictures:
    """Return the drawings of one layer of a part, as it is and mended, in the same colours."""
    before_mm, after_mm = (float(np.quantile(each.off_mm, 0.95)) if len(each.off_mm) else 0.0
                           for each in (view.before, view.after))  # fmt: skip
    worst_mm, left_mm = max(before_mm, after_mm, 0.04), max(after_mm, _FINEST_MM)
    fine_mm = left_mm if left_mm < worst_mm / 2 else None
    both = np.concatenate([np.concatenate(each.lines) for each in (view.before, view.after) if len(each.lines)])
    corners = both.min(axis=0), both.max(axis=0)

    def draw(drawn: DrawnLayer, title: str, seams: np.ndarray) -> Figure:
        high_in = 3.7 * float(np.clip((wide := corners[1] - corners[0])[1] / max(wide[0], 1e-6), 0.3, 1.4)) + 1.15
        figure, axes = new_figure(1, width_in=3.8, height_in=high_in)
        figure.subplots_adjust(left=0.02, right=0.98, top=1 - 0.35 / high_in, bottom=0.8 / high_in)
        draw_coloured(axes[0], drawn.lines, drawn.off_mm, corners_mm=corners, worst_mm=worst_mm, title=title,
                      fine_mm=fine_mm, tell=tell)  # fmt: skip
        if len(seams):
            axes[0].plot(
                *seams.T, "o", markersize=3.5, markerfacecolor="none", color=INK, markeredgewidth=0.8, zorder=9
            )
        return figure

    caption = say("picture-part", view.layer + 1, f"{view.z_mm:.2f}")
    if len(view.seams_mm):
        caption = together(" ", [caption, say("picture-seams", len(view.seams_mm))])
    return Pictures(
        [draw(view.before, say("as-it-is"), np.empty((0, 2))), draw(view.after, say("mended"), view.seams_mm)], caption
    )


def _motor(one: Portrait, tell: Tell) -> Pictures:
    """Draw what was learned of a motor. A round pulley and even play get no picture."""
    unround = float(np.abs(np.hypot(*one.outline_mm.T) - one.radius_mm).max())
    figures = [_fit(one, tell)]
    words = [say("picture-motor", one.name)]
    if unround > LEAST_UNROUND_MM:
        words.append(say("picture-pulley"))
        figures.append(
            _square(lambda axes: draw_hull(axes, one.outline_mm, radius_mm=one.radius_mm, name=one.name, tell=tell))
        )
    play = float(one.play_mm.mean())
    if np.ptp(one.play_mm) > _EVEN_MM:
        words.append(say("picture-play-differs"))
        figures.append(
            _square(lambda axes: draw_play(axes, one.motor_mm, one.play_mm, one.play_sd_mm, name=one.name, tell=tell))
        )
    elif play > 0:
        words.append(say("picture-play-gap", f"{play:.2f}"))
    words.append(say("picture-bands"))
    if abs(one.scale_percent) >= 0.005:
        words.append(say("picture-no-stretch", f"{one.scale_percent:+.2f}"))
    return Pictures(figures, together(" ", words))


def _fit(one: Portrait, tell: Tell) -> Figure:
    figure, axes = new_figure(1, width_in=4.0, height_in=3.0)
    thin = slice(None, None, max(1, len(one.point_side) // MOST_POINTS))
    off = one.point_error_mm - one.level(one.point_motor_mm)
    points = (one.point_motor_mm[thin], off[thin], one.point_side[thin])
    band = 2 * np.hypot(one.sd_mm, one.noise_mm)
    level = one.level(one.motor_mm)
    draw_fit(
        axes[0], one.motor_mm, one.error_mm - level, band, points, name=one.name, mm_per_turn=one.period_mm, tell=tell
    )
    figure.subplots_adjust(left=0.15, right=0.985, top=0.9, bottom=0.17)
    return figure


def _square(draw: Callable[[Axes], Axes]) -> Figure:
    figure, axes = new_figure(1, width_in=3.2, height_in=3.0)
    draw(axes[0])
    figure.subplots_adjust(left=0.17, right=0.97, top=0.9, bottom=0.17)
    return figure


def _bed(examination: Examination, tell: Tell) -> Pictures:
    printer = examination.saved.printer
    bed = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    figures = []
    shown = (examination.before_mm, say("draw-as-printed")), (examination.after_mm, say("draw-unexplained"))
    for errors, title in shown[examination.is_healthy :]:
        figure, axes = new_figure(1, width_in=3.7, height_in=3.7)
        draw_errors(axes[0], examination.places_mm, errors, bed_mm=bed, title=title, tell=tell)
        figure.subplots_adjust(left=0.14, right=0.985, top=0.92, bottom=0.13)
        figures.append(figure)
    return Pictures(figures, say("picture-bed-healthy" if examination.is_healthy else "picture-bed"))


def circle_picture(run: Circle, tell: Tell) -> Pictures:
    """Return the drawing of the circular test."""
    figure, axes = new_figure(1, width_in=3.3, height_in=3.4)
    draw_circle_test(axes[0], run.angle_rad, (run.clockwise_mm, run.counter_mm), radius_mm=run.radius_mm, tell=tell)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.99, bottom=0.01)
    return Pictures([figure], say("picture-circle"))


# An examination as a file: one self-contained page in HTML, or a PDF of two to four pages in A4.

_COLOURS = {"repair": "#c2410c", "soon": "#a16207", "left": "#57534e", "software": "#15803d"}


def write_examination(path: Path, examination: Examination, *, language: str = ENGLISH) -> None:
    """Write the report in a language, in the format that the name of ``path`` asks for."""
    check_name(path)
    tell = tell_in(language)
    blocks = [Words("title", examination.title), *_blocks(examination, tell)]
    if path.suffix.lower() == ".pdf":
        from printmend.draw.document import write_pdf  # reportlab is heavy, and a page needs none of it

        saved = examination.saved
        model = tell(say("model-digest", saved.digest))
        foot = f"{saved.printer.name}, {model}, printmend {printmend.__version__}"
        write_pdf(path, examination.title, blocks, foot=foot, tell=tell)
        return
    from printmend.report.page import page

    with replacing(path) as file:
        file.write(page(examination.title, blocks, tell=tell, language=language))


def _blocks(examination: Examination, tell: Tell) -> Iterator[Block]:
    yield Words("lead", examination.headline)
    yield Strip(numbers(examination))
    yield Words("heading", say("report-nothing-to-do" if examination.is_healthy else "report-to-do"))
    for one in examination.refused:
        yield Card(say("card-measure-again"), "", _COLOURS["repair"], (("", one),))
    for advice in examination.advice:
        lines = (
            ("", advice.meaning), (say("card-to-do"), advice.repair), (say("card-software"), advice.software),
            (say("card-how-sure"), advice.sure),
        )  # fmt: skip
        yield Card(advice.title, URGENCY[advice.urgency], _COLOURS[advice.urgency], lines)
    for one in examination.doubted:
        yield Card(say("card-does-not-fit"), "", _COLOURS["soon"], (("", one),))
    if (prediction := examination.prediction) is not None:
        yield Words("heading", say("report-your-part", examination.part or ""))
        yield Numbers("", part_rows(prediction))
        if len(prediction.layers) > 1:
            yield layers_picture(prediction.layers, examination.part or "", tell)
        if prediction.advice:
            yield Words("text", say("report-before-printing"))
            yield Items(prediction.advice)
    if gaps := closing(examination):
        yield Words("heading", say("report-not-shown"))
        yield Items(gaps)
    yield Words("heading", say("report-pictures"))
    yield from pictures(examination, tell)
    yield from _metrology(examination, tell)
    yield Words("heading", say("report-about"))
    yield from (Words("small", fact) for fact in facts(examination))


def _metrology(examination: Examination, tell: Tell) -> Iterator[Block]:
    yield Words("heading", say("report-metrology"))
    if is_healthy(examination.saved):
        yield Words("text", say("standard-nothing-known"))
    else:
        yield circle_picture(examination.circle, tell)
        yield Numbers(say("standard-said"), standard_rows(examination), words=2)
    if examination.expected is not None:
        yield Numbers(say("budget-said"), budget_rows(examination.expected))
