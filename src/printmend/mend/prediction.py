"""Predict a file's errors before and after mending, and advise on their uncertainty."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from printmend.clock import Duration
from printmend.diagnosis.advice import work_words
from printmend.effects import Scene
from printmend.effects.effect import HARDLY_ANY
from printmend.effects.wobble import shows_push
from printmend.filament import UNNAMED
from printmend.messages import is_one_of, parts_of, say, say_count, together
from printmend.model.model import SavedModel, said_of
from printmend.plan import Planner
from printmend.plan import layout as k
from printmend.promise.belief import parse_belief
from printmend.promise.filament import UNTOLD, are_told, known_filaments, parse_entries
from printmend.promise.predict import Errors, PathPlaces, Promise, best_shift, promised, shape_of, without_doubt
from printmend.promise.words import (
    in_a_line,
    in_words,
    is_on_paper,
    is_resized,
    knows_a_length,
    knows_all_but_a_reading,
)

_EDGE_MM = 0.5  # slicers round: a print that reaches less than this beyond the bed's edge is on the bed
_LEAST_GAIN_MM = 0.0005  # a smaller gain is below the resolution of the numbers in a file
_NO_ERROR_MM = 1e-6  # a smaller RMS error counts as no error
_SHIFT_MM = 0.005  # a smaller shift of the whole print is not reported
_WORTH_ADVICE_MM = 0.03  # another print is worthwhile if the expected error may be larger than this …
_OF_TURNS = (  # messages: gaps that a print over whole turns closes
    "seen-over-part-of-turn", "moved-over-pulley-s-turn-only", "z-heights-span-mm-turn-screw",
    "z-told-mm-only-measure-more",
)  # fmt: skip
_WORTH_CAUSE_MM = (
    0.005  # … and its main cause is larger than this: errors of motion, which dots at rest do not show, always remain
)
_MAIN_SHARE = 0.5  # a cause is named if it is more than this share of the mean square error
_BEYOND_MM = 5.0  # a part that lies farther outside the measured places gets a warning
_TALL_TURNS = 0.1  # of the Z screw, in which a bent one pushes layers aside by up to half as much as it is bent
_WHOLE_MARKS = 400  # a whole test print has at least this many marks
# Largest share of drawn machines that may print no better mended, after a measurement by hand: a few distances leave
# most of what is drawn to the prior.
_MOST_WORSE_SHARE_BY_HAND = 0.01


@dataclass(frozen=True)
class Heights:
    """Error of the nozzle's height, over the length of the extruded path [mm]."""

    rms_mm: float
    max_mm: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """The expected contour error of a file as it is (``before``) and as mended (``after``), with all uncertainties.

    ``path`` holds places along the extruded path. ``gain_mm`` says by how much mending lowers the error of each drawn
    machine; it is None for a model without drawn machines. Mending counts as better while at most the share
    ``most_worse_share`` of them prints no better. ``advice`` says where most of the uncertainty comes from, and which
    print or measurement would settle it.

    Path: ``length_mm`` of extrusion; ``layers`` [L] with z_mm, length_mm and both errors (rms, max) of each.
    ``distance_to`` says what the errors are distances to. ``heights`` are the errors in height before and after, where
    the model has a Z screw.

    Moves: ``moves`` and ``commands`` count what moves the head before and after. ``takeups`` counts the reversals at
    which slack is taken up, ``stops`` those where the nozzle stands still amid an extruded path, ``anchors`` the places
    where the engaged side had to be made certain again, ``coarse`` those beyond the tolerance. ``duration`` is how long
    both files take, None if not asked for.

    Not corrected: ``unknown`` counts extruding moves left as they are, because the file does not say what all their
    words do (``unread``), or where the head is; ``unknown_lines`` are the lines of the first few, and ``doubted_line``
    is the line that made them uncertain (0 if none). ``mended_mm`` is the length of the other moves. ``splines`` counts
    such curves (G5). ``geometry`` counts the commands that make the firmware scale, skew or lengthen its targets.
    ``warnings`` report these commands, and where the firmware may read the file otherwise.

    Bed: printing moves end between ``low_mm`` and ``high_mm``. Everything printed, dots and the beginnings of moves
    included, lies between ``printed_low_mm`` and ``printed_high_mm``; ``on_bed`` says whether that is on the bed.
    ``clamped`` counts commands held back at the edge of the bed, ``clamped_extruding`` those that extrude.
    ``beyond_mm`` says how far out they would have gone, ``held_mm`` how much extruded path that is. The start of the
    file is left out where layer comments mark it: purge lines lie at the edge and need not be right.

    Shift: ``shift_mm`` is the known shift of the whole unmended print. If the errors are ``of_shape``, they leave it
    out, because each homing puts a print elsewhere; those of a model without drawn machines contain it.
    """

    length_mm: float
    before: Promise
    after: Promise
    layers: tuple[dict[str, float], ...]
    moves: int
    commands: int
    takeups: int
    stops: int
    coarse: int
    anchors: int
    clamped: int
    clamped_extruding: int
    beyond_mm: float
    held_mm: float
    unknown: int
    unread: int
    splines: int
    geometry: int
    extruding: int
    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    printed_low_mm: tuple[float, float]
    printed_high_mm: tuple[float, float]
    on_bed: bool
    mended_mm: float
    unknown_lines: tuple[int, ...] = ()
    doubted_line: int = 0
    distance_to: str = field(default_factory=lambda: say("the-wanted-path"))
    heights: tuple[Heights, Heights] | None = None
    advice: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    duration: Duration | None = None
    shift_mm: tuple[float, float] = (0.0, 0.0)
    path: PathPlaces | None = field(default=None, repr=False)
    gain_mm: np.ndarray | None = field(default=None, repr=False)
    most_worse_share: float = field(default=HARDLY_ANY, repr=False)

    @property
    def is_better(self) -> bool:
        """Return whether mending surely gains more than the resolution of the file's numbers."""
        if self.gain_mm is not None and self.heights is None:
            is_gain = float(np.median(self.gain_mm)) > _LEAST_GAIN_MM
            if self.unknown:  # lines that stay as they are do not share the other lines' shift
                is_gain = is_gain and self.before.rms_mm - self.after.rms_mm > _LEAST_GAIN_MM
            return is_gain and float(np.quantile(self.gain_mm, self.most_worse_share)) > 0.0
        return self.is_expected_better

    @property
    def is_expected_better(self) -> bool:
        """Return whether mending is expected to gain more than the resolution of the file's numbers."""
        before, after = self.before.rms_mm, self.after.rms_mm
        if self.heights is not None:
            before, after = math.hypot(before, self.heights[0].rms_mm), math.hypot(after, self.heights[1].rms_mm)
        return before - after > _LEAST_GAIN_MM

    def left_as_it_is(self) -> "Prediction":
        """Return the prediction for a file whose moves all stay as they are."""
        heights = None if self.heights is None else (self.heights[0], self.heights[0])
        return replace(
            self, after=self.before, heights=heights, commands=self.moves, takeups=0, stops=0, coarse=0, anchors=0,
            clamped=0, clamped_extruding=0, held_mm=0.0, beyond_mm=0.0,
        )  # fmt: skip

    @property
    def chance_of_none(self) -> float:
        """The share of drawn machines that would print no better mended; 0 without drawn machines."""
        return 0.0 if self.gain_mm is None else float(np.mean(self.gain_mm <= 0.0))

    @property
    def where_unknown(self) -> str:
        """The lines of the moves that were left as they are, in brackets; empty where unknown."""
        if not self.unknown_lines:
            return ""
        more = [] if self.unknown == len(self.unknown_lines) else ["…"]
        message = "in-line" if self.unknown == 1 else "in-lines"
        return say(message, together(", ", [*map(str, self.unknown_lines), *more]))

    @property
    def left_words(self) -> str:
        """Say how many moves were left as they are, and because of which line; empty for none."""
        if not self.unknown:
            return ""
        why = "unread" if self.unread == self.unknown else "as-written" if self.unread else "unplaced"
        said = say(f"moves-left-{why}", self.unknown, self.where_unknown)
        if self.doubted_line and self.doubted_line not in self.unknown_lines[:1]:
            said = say("moves-left-since", said, self.doubted_line)
        return said

    @property
    def is_untouched(self) -> bool:
        """Return whether every move stays as it is: the model prints it at its place, or nothing was mended."""
        known_mm = max(self.before.planning_rms_mm, self.heights[0].rms_mm if self.heights else 0.0)
        if self.path is not None:  # a pure shift is no error of the shape, but mending would correct it
            known_mm = max(known_mm, float(np.abs(self.path.off_mm).max(initial=0.0)))
        return self.commands == self.moves and (known_mm < _NO_ERROR_MM or self.after == self.before)

    @property
    def shift_words(self) -> str:
        """One sentence about the shift of the whole print; empty without a shift."""
        x_mm, y_mm = self.shift_mm
        if math.hypot(x_mm, y_mm) < _SHIFT_MM or self.is_untouched:
            return ""
        shift = f"{math.hypot(x_mm, y_mm):.2f}", f"{x_mm:+.2f}", f"{y_mm:+.2f}"
        if not self.of_shape:
            return say("print-shifted-included", *shift)
        return say("print-shifted-left-out", *shift, f"{max(self.after.place_mm, _SHIFT_MM):.2f}")

    @property
    def of_shape(self) -> bool:
        """Tell whether the errors leave the print's shift out: those of a model with drawn machines do."""
        return self.gain_mm is not None

    def json(self) -> dict[str, Any]:
        """Return plain values for a report."""
        plain = asdict(replace(self, path=None, gain_mm=None, duration=None))
        plain["duration"] = None if self.duration is None else self.duration.json()
        del plain["path"], plain["gain_mm"], plain["most_worse_share"]
        plain["layers"] = list(self.layers)
        plain |= {"of_shape": self.of_shape, "planning_rms_mm": self.after.planning_rms_mm}
        plain["made_of"] = dict(self.after.made_of)
        if not self.extruding:
            plain["low_mm"] = plain["high_mm"] = None
        if self.printed_low_mm[0] > self.printed_high_mm[0]:  # nothing printed, not even a dot
            plain["printed_low_mm"] = plain["printed_high_mm"] = None
        return plain

    def summary(self) -> str:
        """Return it in a few lines for a terminal."""
        rows: list[str] = [
            say("expected-distance", self.distance_to, f"{self.length_mm / 1000:.1f}"), say("expected-columns"),
        ]  # fmt: skip
        told = (("as-it-is", self.before), ("mended", self.after))[: 1 if self.is_untouched else 2]
        for name, errors in told:
            ranged = f"{errors.rms_low_mm:.3f}–{errors.rms_high_mm:.3f}"
            row = f"{errors.rms_mm:7.3f}  {ranged:>15}  {errors.p95_mm:11.3f}  {errors.max_mm:7.3f}"
            rows.append(say(f"expected-{name}", row))
        for (name, _), height in zip(told, self.heights or (), strict=False):
            rows.append(
                say(f"expected-{name}-in-height", f"{height.rms_mm:7.3f}  {'':15}  {'':11}  {height.max_mm:7.3f}")
            )
        if self.shift_words:
            rows.append(self.shift_words)
        rows += [say("warning", each) for each in self.warnings]
        if self.gain_mm is not None:
            causes = in_a_line(told[-1][1].made_of)
            rows.append(say("causes-after-mending" if len(told) > 1 else "causes", causes))
        rows += [say("before-you-print", each) for each in self.advice]
        return together("\n", [*rows, *self.moves_words()])

    def moves_words(self) -> Iterator[str]:
        """Yield a sentence for each thing that happens to the moves."""
        if not (self.clamped_extruding or self.unknown or self.splines) and self.extruding:
            (x0, y0), (x1, y1) = self.printed_low_mm, self.printed_high_mm
            ends = [f"{end:.0f}" for end in (x0, x1, y0, y1)]
            yield say("stays-on-bed" if self.on_bed else "prints-beyond-bed", *ends)
        if self.is_untouched:
            yield say("nothing-to-mend-every-move-stays")
        else:
            words = say_count("moves-become", self.moves, self.commands)
            if self.takeups:
                words = say("slack-taken-up-at", words, self.takeups)
            yield say("nozzle-stops-at", words, self.stops) if self.stops else words
        if self.duration is not None:
            yield self.duration.words(mended=not self.is_untouched)
        if self.coarse:
            yield say("places-beyond-tolerance", self.coarse)
        if self.left_words:
            yield self.left_words
        if self.splines:
            yield say("curves-not-corrected", self.splines)
        if self.clamped_extruding:
            yield say("moves-held-back-printing", self.clamped, self.clamped_extruding, f"{self.beyond_mm:.2f}")
        elif self.clamped:
            yield say("moves-held-back", self.clamped)


def prediction_of(planner: Planner) -> Prediction:
    """Summarise what a planner recorded about a file."""
    counts, state = planner.counts, planner.state
    layers = planner.layers[: int(counts.layer) + 1]
    length = float(layers["length"].sum())
    low_mm, high_mm = state.print_low, state.print_high
    bed_mm = planner.bed_mm
    errors, heights = [], []
    for which in (0, 1):
        square = float(layers["square"][:, which].sum())
        most = float(layers["most"][:, which].max(initial=0.0))
        errors.append(Errors((square / length) ** 0.5 if length else 0.0, _quantile(planner.errors[which], most), most))
        square, most = (
            float(layers["rise_square"][:, which].sum()),
            float(layers["rise_most"][:, which].max(initial=0.0)),
        )
        heights.append(Heights((square / length) ** 0.5 if length else 0.0, most))
    path = _path_places(planner.samples, layers["z"])
    return Prediction(
        length_mm=length,
        before=without_doubt(errors[0]),
        after=without_doubt(errors[1]),
        layers=tuple(_layer(row, planner.has_screw) for row in layers),
        moves=int(counts.moves),
        commands=int(counts.pieces + counts.copied),
        takeups=int(counts.takeups),
        stops=int(counts.stops),
        coarse=int(counts.coarse),
        anchors=int(counts.anchors),
        clamped=int(counts.clamped),
        clamped_extruding=int(counts.clamped_extruding),
        beyond_mm=float(state.beyond),
        held_mm=float(state.held[int(counts.mark > 0)]),
        unknown=int(counts.unknown),
        unread=int(counts.unread),
        splines=int(counts.splines),
        geometry=int(counts.geometry),
        extruding=int(counts.extruding),
        low_mm=(float(state.low[0]), float(state.low[1])),
        high_mm=(float(state.high[0]), float(state.high[1])),
        printed_low_mm=(float(low_mm[0]), float(low_mm[1])),
        printed_high_mm=(float(high_mm[0]), float(high_mm[1])),
        on_bed=bool((low_mm > bed_mm[0] - _EDGE_MM).all() and (high_mm < bed_mm[1] + _EDGE_MM).all()),
        mended_mm=float(state.drawn),
        doubted_line=int(counts.doubted),
        unknown_lines=tuple(int(line) for line in counts.unknown_at[: counts.unknown]),
        heights=(heights[0], heights[1]) if planner.has_screw else None,
        warnings=(say("file-sets-own-geometry", int(counts.geometry)),) if counts.geometry else (),
        shift_mm=_shift(path),
        path=path,
    )


def _shift(path: PathPlaces | None) -> tuple[float, float]:
    """Return the shift of a whole print [mm]."""
    if path is None or not path.weight.sum() > 0:
        return 0.0, 0.0
    x_mm, y_mm = best_shift(path.tangent, path.off_mm, path.weight)
    return float(x_mm), float(y_mm)


def with_doubt(prediction: Prediction, model: SavedModel) -> Prediction:
    """Return a prediction with the model's advice, and with its uncertainty if the model has drawn machines."""
    belief, prediction = parse_belief(model), replace(prediction, advice=work_words(model))
    if belief is None or prediction.path is None:
        return prediction
    known = [Errors(each.planning_rms_mm, each.p95_mm, each.max_mm) for each in (prediction.before, prediction.after)]
    outlook = promised(model.mechanism, belief, prediction.path, known[0], known[1])
    if outlook is None:
        return prediction
    layers = []
    shape2 = _square_shape_errors(prediction.path)
    for row in prediction.layers:
        more = dict(row)
        for name, whole in (("before", outlook.before), ("after", outlook.after)):
            own_mm = row[f"{name}_rms_mm"]
            if name == "before":  # the file's error excludes the shift, but the layers' errors contain it
                own_mm = math.sqrt(shape2.get(row["z_mm"], shape2[None]))
            more[f"{name}_rms_mm"] = math.hypot(own_mm, doubt_mm(whole))
            more[f"{name}_max_mm"] = max(min(row[f"{name}_max_mm"], whole.max_mm), more[f"{name}_rms_mm"])
        layers.append(more)
    return replace(
        prediction, before=outlook.before, after=outlook.after, gain_mm=outlook.gain_mm, layers=tuple(layers),
        advice=(
            *prediction.advice, *_beyond_seen(model, prediction), *_beyond_a_layer(belief.scene, prediction),
            *_taken_off(model, prediction),
            *advice_of(model, outlook.after),
        ),
        most_worse_share=_MOST_WORSE_SHARE_BY_HAND if belief.by_hand else HARDLY_ANY,
    )  # fmt: skip


def doubt_mm(promise: Promise) -> float:
    """Return the part of an expected error that the model cannot place [mm]. Layers and colours add it alike
    everywhere, so that their RMS is the file's."""
    return math.sqrt(max(promise.rms_mm**2 - promise.planning_rms_mm**2, 0.0))


def _square_shape_errors(path: PathPlaces) -> dict[float | None, float]:
    """Return the mean square error of the places at each height (None: at all) without the part's shift."""
    left2 = shape_of(path) ** 2
    found: dict[float | None, float] = {None: float(np.average(left2, weights=path.weight))}
    if path.z_mm is not None:
        for z_mm in np.unique(path.z_mm):
            here = path.z_mm == z_mm
            found[round(float(z_mm), 4)] = float(np.average(left2[here], weights=path.weight[here]))
    return found


def _beyond_seen(model: SavedModel, prediction: Prediction) -> tuple[str, ...]:
    """Warn of a part that lies outside the area where a small test print had marks."""
    seen = model.document.get("trace", {}).get("seen_mm")
    if seen is None or not (told := said_of(model.document, "unseen")):
        return ()
    found = []
    spans = zip("XY", *seen, prediction.printed_low_mm, prediction.printed_high_mm, strict=True)
    for name, first, last, low, high in spans:
        is_told = any(is_one_of(each, ["axis-from-to-of"]) and each.values["a"] == name for each in parts_of(told[0]))
        if is_told and (low < first - _BEYOND_MM or high > last + _BEYOND_MM):
            found.append(
                say("part-lies-mm-test-print-showed", name, f"{low:.0f}", f"{high:.0f}", f"{first:.0f}", f"{last:.0f}")
            )
    return tuple(found)


def _beyond_a_layer(scene: Scene, prediction: Prediction) -> tuple[str, ...]:
    """Say of a part that is tall that the errors are those within its layers, where no measured ones show how the Z
    screw pushes them aside."""
    heights_mm = [row["z_mm"] for row in prediction.layers]
    is_tall = heights_mm and np.ptp(heights_mm) > _TALL_TURNS * scene.printer.z.mm_per_turn
    return (say("figures-hold-within-layer"),) if is_tall and not shows_push(scene) else ()


def _taken_off(model: SavedModel, prediction: Prediction) -> tuple[str, ...]:
    """Say beside a print's shift that another one, which learning took off its test print, is no part of it."""
    return (say("shift-taken-off"),) if prediction.shift_words and said_of(model.document, "moved") else ()


def advice_of(model: SavedModel, after: Promise) -> tuple[str, ...]:
    """Say what the promise leaves out, and the main cause of a mended print's uncertainty if another print is worth
    it."""
    return (*said_of(model.document, "jump"), *_most_of(model, after))


def _most_of(model: SavedModel, after: Promise) -> tuple[str, ...]:
    """Name the main cause of a mended print's uncertainty."""
    if after.rms_high_mm < _WORTH_ADVICE_MM:
        return ()
    name = max(after.made_of, key=lambda each: after.made_of[each])
    if (
        after.made_of[name] ** 2 < _MAIN_SHARE * after.combined_mm**2
        or after.made_of[name] < _WORTH_CAUSE_MM
        or name in ("planning", "rounding", "motion")
    ):
        return ()
    return (answer_to(model, name) or say("rest-is-cause", in_words(name)),)


def answer_to(model: SavedModel, cause: str) -> str | None:
    """Name the main cause of an error, and the measurement that would narrow it; None where none would."""
    by_hand = model.document.get("promise", {}).get("by_hand")  # there is no scan to settle
    if cause == "parameters" or by_hand:
        gaps = [gap for gap in model.findings[1:] if is_one_of(gap, _OF_TURNS)]
        whole = model.document.get("trace", {}).get("measured", 0) >= _WHOLE_MARKS
        if gaps:
            return say("rest-not-shown", gaps[0])
        if whole:
            return say("rest-left-open", say("second-test-print-taken-printmend-learn"))
        return say("rest-not-shown", say("whole-printmend-probe-printed-measured-settles"))
    if cause == "homing":
        return say("rest-is-homing")
    if cause not in ("instrument", "filament"):
        return None
    if cause == "filament" and UNNAMED in known_filaments(model):
        return say("rest-is-filament")
    if untold := [gap for gap in model.findings[1:] if is_one_of(gap, UNTOLD[: 2 if cause == "filament" else 1])]:
        return say("rest-untold", untold[0])
    if are_told(parse_entries(model) or ()):
        return say("rest-is-reading")
    if is_on_paper(model):
        return say("rest-is-paper", say("scale-settled-by-travel"))
    if knows_all_but_a_reading(model):
        return say("rest-is-reading")
    if knows_a_length(model):
        return say("rest-is-scanner-across")
    return say("rest-is-picture" if is_resized(parse_belief(model)) else "rest-is-scanner")


def _path_places(samples: np.record, layer_z_mm: np.ndarray) -> PathPlaces:
    found = samples.kept[: samples.count]
    return PathPlaces(
        found["place"].copy(), found["tangent"].copy(), found["off"].copy(), found["side"].copy(),
        found["weight"].copy(), layer_z_mm[found["layer"]], ways=found["ways"].copy(),
        strokes_mm=found["strokes"].copy(),
    )  # fmt: skip


def _quantile(histogram: np.ndarray, most: float) -> float:
    """Return the 95th percentile from a histogram of mm of path; beyond its end it is the maximum."""
    total = histogram.sum()
    if total == 0:
        return 0.0
    below = np.cumsum(histogram)
    at = int(np.searchsorted(below, 0.95 * total))
    if at == len(histogram) - 1:
        return most
    part = 1.0 - (below[at] - 0.95 * total) / histogram[at]
    return float(min((at + part) * k.ERROR_BIN_MM, most))


def _layer(row: np.void, has_screw: bool) -> dict[str, float]:
    length = row["length"]
    squares = row["square"] / length if length else np.zeros(2)
    layer = {
        "z_mm": round(float(row["z"]), 4),
        "length_mm": round(float(length), 3),
        "before_rms_mm": float(squares[0] ** 0.5),
        "before_max_mm": float(row["most"][0]),
        "after_rms_mm": float(squares[1] ** 0.5),
        "after_max_mm": float(row["most"][1]),
    }
    if has_screw:
        rises = row["rise_square"] / length if length else np.zeros(2)
        layer["before_height_rms_mm"], layer["after_height_rms_mm"] = np.sqrt(rises).tolist()
    return layer
