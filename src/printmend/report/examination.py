"""What is wrong with a printer, as a document for its owner: words, advice, and what it means for a part."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import printmend
from printmend.diagnosis.advice import Advice, advise
from printmend.diagnosis.portrait import Portrait, contacts_of_fit, portrait
from printmend.diagnosis.scale import scale_words
from printmend.diagnosis.standard import Circle, Positioning, circle, positioning
from printmend.effects.words import Fault as NamedFault
from printmend.errors import InputError
from printmend.infer.fit import Fit
from printmend.learn.learned import learn, scatter_words, todo
from printmend.mend.filament import grown, settled
from printmend.mend.mend import check_gcode
from printmend.mend.prediction import Prediction
from printmend.mend.verify import expectation
from printmend.messages import say, together
from printmend.model import SavedModel
from printmend.model.misfit import NOTE, REFUSAL, misfit_words, said_of
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.belief import parse_belief
from printmend.promise.predict import Promise

SUFFIXES = (".html", ".htm", ".pdf")
MOST_ARROWS = 1200  # in a picture
LEAST_ADVICE_MM = 0.01  # a fault that shifts a print by less is not worth a paragraph
URGENCY = {
    "repair": say("urgency-repair"), "soon": say("urgency-soon"), "software": say("urgency-software"),
}  # fmt: skip


AFTER_WORK = say("after-work")


@dataclass(frozen=True, eq=False)
class Examination:
    """A trace's fit with all that its report shows; ``part`` and ``prediction`` where a part was given.

    ``finer`` is the number of faults too small to be shown, ``misfit`` says what does not fit. ``expected`` is what a
    mended copy of the test print should be like.
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
        """Whether nothing is to be done: a note, as of a plate that lay shifted, is of the measurement."""
        return not (self.advice or any(not each.startswith(f"{NOTE}: ") for each in self.misfit))

    @property
    def refused(self) -> tuple[str, ...]:
        """Why nothing is mended by this measurement: it comes before all that was learned from it."""
        return tuple(each for each in self.misfit if each.startswith(f"{REFUSAL}: "))

    @property
    def doubted(self) -> tuple[str, ...]:
        """What else does not fit."""
        return tuple(each for each in self.misfit if each not in self.refused)

    @property
    def gaps(self) -> tuple[str, ...]:
        """What the trace could not tell, a sentence each."""
        return self.saved.findings[1:]

    @property
    def before_rms_mm(self) -> float:
        """How far the test print's points typically lie from where they belong."""
        return float(self.saved.document["trace"]["residual_before_mm"])

    @property
    def after_rms_mm(self) -> float:
        """How much of that nothing explains."""
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
    """Learn a machine from a trace and say all that is known of it; ``part`` is G-code whose error is predicted,
    ``filament`` what the measured part was printed in.

    Raises `TraceError` like `learn`, `GcodeError` or `ModelError` for a part that cannot be printed here.
    """
    learned = learn(grown(trace, printer, filament), printer, rng=rng)
    saved, flat, fit = settled(learned.saved, filament), learned.trace, learned.fit
    assert fit is not None  # the search is never without
    corexy = printer.kinematics == "corexy"
    order = list(URGENCY)
    names = ("part", "kind", "value", "sd", "unit")
    faults = [NamedFault(**{name: one[name] for name in names}, words="") for one in saved.document["diagnosis"]]
    rails = bool(said_of(saved.document, "rail-play"))
    all_advice = [advise(fault, corexy=corexy, rails=rails) for fault in faults]
    advice = [one for one in all_advice if one.effect_mm >= LEAST_ADVICE_MM or one.urgency != "software"]
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
        sum(one not in advice and fault.kind != "offset" for fault, one in zip(faults, all_advice, strict=True)),
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
    if any(one.urgency != "software" for one in examination.advice):
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
    """Return the few numbers that matter, each with its words: what to expect after mending comes first."""
    found = []
    if (prediction := examination.prediction) is not None:
        before, after = prediction.before, prediction.after
        ranged = f"; mended between {after.rms_low_mm:.3f} and {after.rms_high_mm:.3f} in nine of ten prints"
        about = f"your part {examination.part}, as it is → mended{ranged if after.made_of else ''}"
        found.append((f"{before.rms_mm:.2f} → {after.rms_mm:.3f} mm", about))
    return [
        *found,
        (f"{examination.before_rms_mm:.3f} mm", "how far the test print typically lies from where it belongs"),
        (
            f"{examination.after_rms_mm:.3f} mm",
            f"of that nothing explains; {scatter_words(examination.saved)}",
        ),
    ]


def standard_rows(examination: Examination) -> list[tuple[str, ...]]:
    """Return the table of the metrologist's names and the owner's words, its head first [mm]."""
    x, y = examination.axes
    run = examination.circle

    def row(name: str, words: str, *sizes: float) -> tuple[str, ...]:
        return (name, words, *(f"{size:.3f}" for size in sizes), *[""] * (2 - len(sizes)))

    return [
        ("in the standard", "in other words", "X", "Y"),
        row("reversal error B", "play: what is lost when it turns back, at most", x.reversal_mm, y.reversal_mm),
        row("mean reversal error B̄", "the same, on average", x.mean_reversal_mm, y.mean_reversal_mm),
        row("bidirectional systematic error E", "farthest too far to farthest too short", x.systematic_mm,
            y.systematic_mm),
        row("mean bidirectional error M", "the same without the play", x.mean_mm, y.mean_mm),
        row("circular error G", "how unround a circle is, clockwise; counter-clockwise", *run.circular_mm),
        row("bidirectional circular error G(b)", "both together", run.both_mm),
        row("mean radial error D", "how much too large it is", run.mean_mm),
    ]  # fmt: skip


NOTHING_KNOWN = "No error of positioning and no error of a circle is known of this printer."
STANDARD_SAID = (
    "Positioning along the bed's middle by the names of ISO 230-2, and a circle by those of ISO 230-4, in mm. The "
    "learned model ran these paths, not the printer: accuracy A and repeatability R need five measured runs, and are "
    "not here."
)


def facts(examination: Examination) -> list[str]:
    """Return the small print."""
    saved = examination.saved
    return [
        f"{saved.printer.name}, {saved.document['trace']['measured']} measured points, each with about "
        f"{saved.noise_mm:.3f} mm of measuring noise in x and in y",
        f"in short: {saved.findings[0]}",
        f"model {saved.digest}, printmend {printmend.__version__}; learned, not looked at: check before you buy parts",
    ]


def closing(examination: Examination) -> tuple[str, ...]:
    """Return what the trace could not tell, and which print would."""
    return (*examination.gaps, *todo(examination.gaps))
