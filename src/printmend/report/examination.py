"""What is wrong with a printer, as a document for its owner: words, advice, and what it means for a part."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import printmend
from printmend.diagnosis.advice import URGENCY, WORK, Advice, advised
from printmend.diagnosis.portrait import Circle, Portrait, Positioning, circle, contacts_of_fit, portrait, positioning
from printmend.effects.words import LEAST_SHOWN
from printmend.errors import InputError
from printmend.infer.fit import Fit
from printmend.learn.learned import errors_mm, learn, scatter_words, todo
from printmend.mend.filament import filament_of, grown, settled
from printmend.mend.mend import check_gcode
from printmend.mend.prediction import Prediction
from printmend.mend.verify import expectation
from printmend.messages import is_one_of, parts_of, say, together
from printmend.model import SavedModel
from printmend.model.model import NOTE, REFUSAL, misfit_words
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.belief import parse_belief
from printmend.promise.predict import Promise
from printmend.promise.words import scale_words
from printmend.report.part import before_and_after

SUFFIXES = (".html", ".htm", ".pdf")
MOST_ARROWS = 1200  # in a picture
AFTER_WORK = say("after-work")


@dataclass(frozen=True, eq=False)
class Examination:
    """A trace's fit with everything that its report shows; ``part`` and ``prediction`` if a part was given.

    ``finer`` is the number of faults too small to show; ``has_walls``: walls were measured, and not dots alone.
    ``misfit`` holds the findings that the model does not fit. ``expected`` is the promise for the mended part, without
    one for a mended copy of the test print.
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
    has_walls: bool

    @property
    def title(self) -> str:
        """The report's title."""
        return say("title-healthy" if self.is_healthy else "title-wrong")

    @property
    def is_healthy(self) -> bool:
        """Whether there is nothing to do. Notes do not count: they concern the measurement, say a shifted plate; but
        one that leaves a motor open does."""
        is_open = any(is_one_of(part, ["motor-open"]) for part in parts_of(self.saved.findings[0]))
        return not (is_open or self.advice or any(not is_one_of(each, [NOTE]) for each in self.misfit))

    @property
    def refused(self) -> tuple[str, ...]:
        """The refusals: why this measurement cannot mend anything. They come before all findings."""
        return tuple(each for each in self.misfit if is_one_of(each, [REFUSAL]))

    @property
    def doubted(self) -> tuple[str, ...]:
        """The other findings that the model does not fit."""
        return tuple(each for each in self.misfit if each not in self.refused)

    @property
    def gaps(self) -> tuple[str, ...]:
        """The things that the trace did not show, a sentence for each."""
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
    advice = [one for _, one in found if one.effect_mm >= LEAST_SHOWN or one.urgency in WORK]
    advice.sort(key=lambda one: (order.index(one.urgency), -one.effect_mm))
    mechanism, prediction = saved.mechanism, None if part is None else check_gcode(part, saved)
    if prediction is None:
        expected = expectation(saved, flat)
    else:
        expected = None if prediction.gain_mm is None else prediction.after
    return Examination(
        saved, tuple(advice), (_portrait(saved, fit, 0), _portrait(saved, fit, 1)),
        (positioning(mechanism, 0), positioning(mechanism, 1)), circle(mechanism),
        *_arrows(flat, fit), None if part is None else part.name, prediction,
        sum(one not in advice and row["kind"] != "offset" for row, one in found),
        (*scale_words(saved), *misfit_words(saved.document)), expected, fit.scene.walls,
    )  # fmt: skip


def _arrows(trace: Trace, fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return measured places [N, 2], their errors before mending and the unexplained part: of a wall, across it."""
    rows, count = fit.rows, len(trace)
    off_mm = errors_mm(trace, fit, fit.parts(), trace.measured_rows)
    before_mm = rows.at_places(np.einsum("mc,mc->m", rows.along, off_mm[rows.mark]), count)
    shown = np.unique(rows.mark)
    shown = shown[np.isfinite(before_mm[shown]).all(axis=1)]
    shown = shown[:: max(1, len(shown) // MOST_ARROWS)]
    return trace.commanded_mm[shown], before_mm[shown], rows.at_places(fit.left_mm(), count)[shown]


def _portrait(saved: SavedModel, fit: Fit, motor: int) -> Portrait:
    belief = parse_belief(saved)
    assert belief is not None
    return portrait(belief.parts, fit.scene, motor, contacts_of_fit(fit, motor), saved.noise_mm)


def summary(examination: Examination) -> str:
    """Return the report's summary in a few lines for a terminal."""
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
    """Return the most important numbers with their words; the expected error after mending comes first."""
    found: list[tuple[str, str]] = []
    if (prediction := examination.prediction) is not None:
        found.append(before_and_after(prediction, say("number-your-part", examination.part or "")))
    return [
        *found,
        (say("mm-2", f"{examination.before_rms_mm:.3f}"), say("number-measured-print")),
        (
            say("mm-2", f"{examination.after_rms_mm:.3f}"),
            say("number-unexplained", scatter_words(examination.saved)),
        ),
    ]


def standard_rows(examination: Examination) -> list[tuple[str, ...]]:
    """Return a table of errors [mm] with the names of metrology and words for owners, its head first."""
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
    """Return the report's sources."""
    saved = examination.saved
    return [
        say("fact-measured", saved.printer.name, saved.document["trace"]["measured"], f"{saved.noise_mm:.3f}"),
        say("fact-in-short", saved.findings[0]),
        say("fact-model", saved.digest, printmend.__version__),
    ]


def closing(examination: Examination) -> tuple[str, ...]:
    """Return the gaps of the trace, and the print that would close them."""
    return (*examination.gaps, *todo(examination.gaps))
