"""A printer's history: every measurement as one JSON line beside the model, and the trend of its wear.

The history of printer.mend.json is printer.mend.history.jsonl. Each line has its ``event`` (learned, updated or
verified), ``time`` and the ``model`` that resulted. A fault's trend is a straight line through its sizes since the last
repair, weighted by their uncertainty. Two sizes matter: the one that shifts a print by a tenth of a millimetre, and
the one that shifts it by half a millimetre, at which the fault should be repaired.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from printmend.diagnosis.advice import REPAIR_MM, SOON_MM, advise
from printmend.diagnosis.named import kind_words, part_words
from printmend.effects.words import Fault as NamedFault
from printmend.errors import ModelError
from printmend.files import read_text, replacing
from printmend.messages import Tell, say, together
from printmend.model.model import SavedModel

if TYPE_CHECKING:
    from printmend.draw.figure import Wear

YEAR_S = 365.25 * 86400.0
MONTH_S = YEAR_S / 12
LEAST_SD = 0.003  # least standard deviation of a fault's size [mm, % or °]: prints of one machine differ by this
ABSENT_SD = 0.015  # standard deviation of the size [mm, % or °] of a fault that was not found
TREND_SIGMAS = 2.0  # a slope of more standard deviations is a trend
REPAIRED_SHARE = 0.5  # a fault was repaired if its size surely falls below this share of the last
REPAIRED_SIGMAS = 4.0  # least standard deviations of a sure fall
FARTHEST_YEARS = 20.0  # wear is predicted no further
# The kinds of fault that are forms of play.
PLAYS = ("play", "friction", "loose-belt", "play-by-angle")
LEAST_RUN = 3  # fewest measurements since the last repair that show a trend
MOST_DRAWN = 4  # most faults in the picture, the worst first
DRAWN_YEARS = 3.0  # how far past the last measurement the picture goes
CROSSING_DRAWS = 2000  # lines drawn to find when a trend reaches a level; the 5 % quantile is then known to 0.5 %
MEASUREMENT = "measurement"  # the key of a measurement's digest
_MESSAGES = {  # of events, and of results of a check print
    "learned": "event-learned", "updated": "event-updated", "verified": "event-verified",
    "refitted": "event-refitted", "kept": "result-kept", "broken": "result-broken", "cannot tell": "result-cannot-tell",
}  # fmt: skip
_TODO = say("move-away-model-itself-does-not")


@dataclass(frozen=True)
class Size:
    """One fault at one time: ``time_s`` since 1970, its ``value`` ± ``sd``."""

    time_s: float
    value: float
    sd: float


@dataclass(frozen=True)
class Passed:
    """A size that a fault has passed: the ``level`` that shifts a print by ``effect_mm``, and the time ``when_s`` since
    1970, None if the fault passed it before the first measurement."""

    level: float
    effect_mm: float
    when_s: float | None


@dataclass(frozen=True)
class Trend:
    """A fault over time: its ``sizes``, of which number ``since`` is the trend's first, its growth ``per_month`` ±
    ``per_month_sd``, and the size it has ``passed``. ``level`` is the next size that matters: it shifts a print by
    ``effect_mm``. The fault reaches it at ``crossing_s``, given with its range; None if that is not in sight."""

    fault: NamedFault
    sizes: tuple[Size, ...]
    since: int
    per_month: float
    per_month_sd: float
    passed: Passed | None
    level: float
    effect_mm: float
    crossing_s: float | None
    earliest_s: float | None
    latest_s: float | None

    @property
    def name(self) -> str:
        """The part and what is wrong with it."""
        return say("motor-quantity", part_words(self.fault.part), kind_words(self.fault.kind))

    @property
    def is_sure(self) -> bool:
        """True if the fault surely grows or shrinks."""
        return abs(self.per_month) > TREND_SIGMAS * self.per_month_sd

    @property
    def words(self) -> str:
        """Say how large the fault is, which size it has passed and will reach, and what to do."""
        unit, size = self.fault.unit, self.fault.size
        said = say("history-now", f"{size:.3f}", unit)
        if len(self.sizes) - self.since < LEAST_RUN:
            said = say("history-few", said)
        elif not self.is_sure:
            said = say("history-steady", said)
        else:
            grows = "history-grows" if self.per_month > 0 else "history-shrinks"
            said = say(grows, said, f"{abs(self.per_month):.3f}", unit)
        return together("", filter(None, (said, self._passed_words, self._ahead_words)))

    @property
    def _passed_words(self) -> str:
        if self.passed is None:
            return ""
        size, effect, advice = self.passed.level, f"{self.passed.effect_mm:g}", self._advice(self.fault.value)
        if self.passed.when_s is None:
            return say("history-passed-before", self._size_words(size), effect, advice)
        return say("history-passed", self._size_words(size), _month(self.passed.when_s), effect, advice)

    @property
    def _ahead_words(self) -> str:
        if self.crossing_s is None:
            return ""
        when = _month(self.crossing_s)
        if self.earliest_s is not None and self.latest_s is None:
            when = say("history-not-before", when, _month(self.earliest_s))
        elif self.earliest_s is not None and self.latest_s is not None:
            when = say("history-between", when, _month(self.earliest_s), _month(self.latest_s))
        reached = (self._size_words(self.level), when, f"{self.effect_mm:g}")
        if self.passed is None:
            return say("history-will-reach", *reached, self._advice(self.level))
        return say("history-will-reach-next", *reached)

    def _size_words(self, level: float) -> str:
        return say("history-size", f"{level:.2f}", self.fault.unit)

    def _advice(self, size: float) -> str:
        return advise(replace(self.fault, value=size)).repair

    def json(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "part": self.fault.part, "kind": self.fault.kind, "unit": self.fault.unit,
            "sizes": [{"time": _iso(one.time_s), "value": one.value, "sd": one.sd} for one in self.sizes],
            "per_month": self.per_month, "per_month_sd": self.per_month_sd,
            "passed": None if self.passed is None else {
                "level": self.passed.level, "effect_mm": self.passed.effect_mm, "when": _iso(self.passed.when_s),
            },
            "level": self.level, "effect_mm": self.effect_mm,
            "crossing": _iso(self.crossing_s), "earliest": _iso(self.earliest_s), "latest": _iso(self.latest_s),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Ageing:
    """The age of the last measurement in ``months``, and how much (± standard deviation) faults should have ``grown``
    since: for each part, in capitals, its play [mm] and scale [%], if three measurements show a trend."""

    months: float
    grown: Mapping[tuple[str, str], tuple[float, float]]

    def of(self, part: str) -> dict[str, tuple[float, float]]:
        """Return the expected growth of one motor's faults."""
        return {kind: size for (name, kind), size in self.grown.items() if name == part.upper()}

    @property
    def words(self) -> str:
        """Say which growth was expected."""
        said = [
            say("history-grown", part, kind_words(kind), f"{more:+.3f} ± {sd:.3f} {'%' if kind == 'scale' else 'mm'}")
            for (part, kind), (more, sd) in self.grown.items()
            if abs(more) > sd
        ]
        if not said:
            return ""
        return say("history-added", f"{self.months:.1f}", together("; ", said))


def history_of(model_path: Path) -> Path:
    """Return the path of a model's history, which lies beside it."""
    return model_path.parent / (model_path.name.removesuffix(".json") + ".history.jsonl")


def remember(
    model_path: Path, model: SavedModel, event: str, values: Mapping[str, Any], *, when: datetime | None = None
) -> Path:
    """Add an event to a model's history; return the file.

    A measurement counts once, and so does an event that repeats the last one: the new line takes the place of the old
    one. It keeps the old time, unless ``when`` gives another.
    """
    path = history_of(model_path)
    lines = _lines(path)
    time = (when or datetime.now(UTC)).isoformat(timespec="seconds")
    line = {"event": event, "time": time, "model": model.digest, **values}
    rounded = {key: round(value, 5) if isinstance(value, float) else value for key, value in line.items()}
    if (at := _place_of(lines, json.loads(json.dumps(rounded)))) is None:
        lines.append(json.dumps(rounded))
    else:
        old = {**rounded, **_event_in(lines[at])}
        lines[at] = json.dumps({**rounded, "event": old["event"], "time": time if when else old["time"]})
    with replacing(path) as file:
        file.writelines(f"{each}\n" for each in lines)
    return path


def _lines(path: Path) -> list[str]:
    """Return the lines of a history, none where there is no such file."""
    return read_text(path, wanted=say("history"), todo=_TODO, error=ModelError).splitlines() if path.exists() else []


def _event_in(line: str) -> dict[str, Any]:
    """Return the event of a line, an empty one where the line is damaged."""
    with suppress(ValueError, RecursionError):
        found = json.loads(line)
        return found if isinstance(found, dict) else {}
    return {}


def _place_of(lines: Sequence[str], event: Mapping[str, Any]) -> int | None:
    """Return the number of the line whose place an event takes: that of its measurement, or the last one if that says
    the same."""
    for at, old in enumerate(map(_event_in, lines)):
        repeats = at == len(lines) - 1 and {**old, "time": event["time"]} == event
        if repeats or (MEASUREMENT in event and old.get(MEASUREMENT) == event[MEASUREMENT]):
            return at
    return None


def has_measurement(model_path: Path, measurement: str | None) -> bool:
    """Say whether a model's history has a measurement with this digest already."""
    events = map(_event_in, _lines(history_of(model_path)))
    return measurement is not None and any(event.get(MEASUREMENT) == measurement for event in events)


def carry_on(old_path: Path, model_path: Path) -> None:
    """Add the events of an old model's history to that of its successor, if it has one; the old file stays as it is."""
    old, new = history_of(old_path), history_of(model_path)
    if old == new or not old.exists():
        return
    earlier, own = map(_lines, (old, new))
    with replacing(new) as file:
        file.writelines(f"{line}\n" for line in (*earlier, *(each for each in own if each not in earlier)))


def remember_learned(
    model_path: Path, model: SavedModel, source: str, *, measurement: str | None = None, updated: bool = False,
    when: datetime | None = None,
) -> Path:  # fmt: skip
    """Record the result of a ``measurement``, by its digest: the printer's faults, and how well the model fits."""
    trace, own = model.document.get("trace", {}), {} if measurement is None else {MEASUREMENT: measurement}
    if model.document.get("update", {}).get("of") == "z":  # heights alone are no new measurement of X and Y
        faults = [row for row in model.document.get("diagnosis", []) if row["part"] == "z"]
        return remember(model_path, model, "updated", {"source": source, **own, "heights": faults}, when=when)
    values = {
        "source": source, **own, "faults": model.document.get("diagnosis", []), "noise_mm": float(model.noise_mm),
        "points": trace.get("measured"), "before_mm": trace.get("residual_before_mm"),
    }  # fmt: skip
    return remember(model_path, model, "updated" if updated else "learned", values, when=when)


def read_history(model_path: Path) -> tuple[dict[str, Any], ...]:
    """Return the events of a model's history in order of time. Raises `ModelError` for a file that is no history."""
    path = history_of(model_path)
    if not path.exists():
        read_text(model_path, wanted=say("printer-mend-json"), todo=say("check-path"), error=ModelError)
        todo = say("learn-update-verify-model-each-adds")
        raise ModelError(path, wanted=say("history"), came=say("no-such-file"), todo=todo)
    events = []
    text = read_text(path, wanted=say("history"), todo=_TODO, error=ModelError)
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            event = json.loads(line)
            event["seconds"] = _seconds(event["time"])
            for fault in (*event.get("faults", []), *event.get("heights", [])):
                NamedFault(fault["part"], fault["kind"], float(fault["value"]), float(fault["sd"]), fault["unit"], "")
                if not np.isfinite([fault["value"], fault["sd"]]).all():
                    raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ModelError(
                path, wanted=say("json-object-time-every-line"), came=say("another-line", number), todo=_TODO
            ) from None
        events.append(event)
    return tuple(sorted(events, key=lambda event: event["seconds"]))


def trends_of(events: Sequence[Mapping[str, Any]]) -> tuple[Trend, ...]:
    """Return the trend of every fault that was ever found, the worst first."""
    seen = [event for event in events if "faults" in event]
    names: dict[tuple[str, str], tuple[str, str]] = {}
    for event in seen:
        for fault in event["faults"]:
            family = _fault_family(fault["kind"])
            names[(fault["part"], family)] = (fault["kind"] if family == "period" else family, fault["unit"])
    found = []
    for (part, family), (kind, unit) in names.items():
        sizes = []
        for event in seen:
            one = [each for each in event["faults"] if (each["part"], _fault_family(each["kind"])) == (part, family)]
            value, sd = (one[0]["value"], one[0]["sd"]) if one else (0.0, ABSENT_SD)
            sizes.append(Size(float(event["seconds"]), abs(float(value)), max(float(sd), LEAST_SD)))
        found.append(_trend(part, kind, unit, tuple(sizes)))
    return tuple(sorted(found, key=lambda trend: -advise(trend.fault).effect_mm))


def ageing_of(model_path: Path, when: datetime | None = None) -> Ageing | None:
    """Return the ageing that a model's history predicts from its last measurement until ``when`` (default: now), None
    without a measurement. Raises `ModelError` for a file that is no history."""
    if not history_of(model_path).exists():
        return None
    events = [event for event in read_history(model_path) if "faults" in event]
    if not events:
        return None
    last = max(float(event["seconds"]) for event in events)
    months = max((when or datetime.now(UTC)).timestamp() - last, 0.0) / MONTH_S
    grown: dict[tuple[str, str], tuple[float, float]] = {}
    for trend in trends_of(events):
        if trend.fault.kind in (*PLAYS, "scale") and len(trend.sizes) - trend.since >= LEAST_RUN:
            more = trend.per_month if trend.is_sure else 0.0
            slope_sd = trend.per_month_sd if trend.is_sure else np.hypot(trend.per_month, trend.per_month_sd)
            sd = float(np.hypot(slope_sd * months, _random_walk(trend) * np.sqrt(months)))
            grown[trend.fault.part.upper(), _fault_family(trend.fault.kind)] = (more * months, sd)
    return Ageing(months, grown)


def _random_walk(trend: Trend) -> float:
    """Return the random walk of a fault about its trend, as a standard deviation after one month.

    This is the fault's scatter between measurements beyond their own uncertainty.
    """
    run = trend.sizes[trend.since :]
    months = np.diff([one.time_s for one in run]) / MONTH_S
    strayed = np.diff([one.value for one in run]) - trend.per_month * months
    doubt2 = np.square([one.sd for one in run])
    excess = float(np.sum(strayed**2 - doubt2[1:] - doubt2[:-1]))
    return float(np.sqrt(max(excess, 0.0) / max(float(months.sum()), 1e-6)))


def _fault_family(kind: str) -> str:
    """Return the fault of which a kind is a form: play may look constant today and loose tomorrow, and an idler's
    estimated period (period-31.4) varies from print to print."""
    if kind.startswith("period-"):
        return "period"
    return "play" if kind in PLAYS else kind


def _trend(part: str, kind: str, unit: str, sizes: tuple[Size, ...]) -> Trend:
    """Fit a straight line through a fault's sizes since its last repair, weighted by their uncertainty.

    If they scatter about the line by more than that, the line's own uncertainty grows in proportion.
    """
    since = 0
    for k in range(1, len(sizes)):
        fell = sizes[k - 1].value - sizes[k].value
        fall_sd = np.hypot(sizes[k].sd, sizes[k - 1].sd)
        if sizes[k].value < REPAIRED_SHARE * sizes[k - 1].value and fell > REPAIRED_SIGMAS * fall_sd:
            since = k
    fault = NamedFault(part, kind, sizes[-1].value, sizes[-1].sd, unit, "")
    run = sizes[since:]
    if len(run) < LEAST_RUN:
        passed, ahead_mm = _passed(fault, run, None)
        return Trend(fault, sizes, since, 0.0, np.inf, passed, _level(fault, ahead_mm), ahead_mm, None, None, None)
    now = run[-1].time_s
    months = np.array([(one.time_s - now) / MONTH_S for one in run])
    values, sd = np.array([one.value for one in run]), np.array([one.sd for one in run])
    columns = np.stack([np.ones(len(run)), months], axis=1) / sd[:, None]
    covariance = np.linalg.pinv(columns.T @ columns)
    here, slope = (float(one) for one in covariance @ (columns.T @ (values / sd)))
    misfit = float(np.sum(((values - here - slope * months) / sd) ** 2) / max(len(run) - 2, 1))
    covariance = covariance * max(misfit, 1.0)
    slope_sd = float(np.sqrt(covariance[1, 1]))
    fault = NamedFault(part, kind, max(here, 0.0), float(np.sqrt(covariance[0, 0])), unit, "")
    grows = slope > TREND_SIGMAS * slope_sd
    passed, ahead_mm = _passed(fault, run, slope if grows else None)
    level = _level(fault, ahead_mm)
    crossing = earliest = latest = None
    if grows and here < level:
        crossing, earliest, latest = _crossing(here, slope, covariance, level, now)
    return Trend(fault, sizes, since, slope, slope_sd, passed, level, ahead_mm, crossing, earliest, latest)


def _passed(fault: NamedFault, run: Sequence[Size], slope: float | None) -> tuple[Passed | None, float]:
    """Return the size that a fault has passed, and by how many mm it shifts a print at the next size that matters.

    If it grows by ``slope`` a month, its trend says when it passed. Otherwise the time is interpolated between the last
    smaller measurement of ``run`` and the next one.
    """
    effects_mm = [effect_mm for effect_mm in (SOON_MM, REPAIR_MM) if fault.value >= _level(fault, effect_mm)]
    ahead_mm = REPAIR_MM if effects_mm else SOON_MM
    if not effects_mm:
        return None, ahead_mm
    level = _level(fault, effects_mm[-1])
    when_s = None
    if slope is not None:
        when_s = run[-1].time_s - (fault.value - level) / slope * MONTH_S
    elif smaller := [k for k, one in enumerate(run[:-1]) if one.value < level]:
        before, after = run[smaller[-1]], run[smaller[-1] + 1]
        share = (level - before.value) / max(after.value - before.value, 1e-9)
        when_s = before.time_s + min(max(share, 0.0), 1.0) * (after.time_s - before.time_s)
    if when_s is not None and when_s <= run[0].time_s:
        when_s = None
    return Passed(level, effects_mm[-1], when_s), ahead_mm


def _crossing(
    here: float, slope: float, covariance: np.ndarray, level: float, now_s: float
) -> tuple[float | None, float | None, float | None]:
    """Return when a line reaches a level, and the 90 % range from drawn lines (Fieller's would be exact)."""
    drawn = np.random.default_rng(0).multivariate_normal([here, slope], covariance, CROSSING_DRAWS)
    with np.errstate(divide="ignore", invalid="ignore"):
        months = np.where(drawn[:, 1] > 0, np.maximum(level - drawn[:, 0], 0.0) / drawn[:, 1], np.inf)
    low, high = np.quantile(months, (0.05, 0.95), method="nearest")

    def at(month: float) -> float | None:
        return now_s + month * MONTH_S if month < 12 * FARTHEST_YEARS else None

    return at((level - here) / slope), at(float(low)), at(float(high))


def _level(fault: NamedFault, effect_mm: float) -> float:
    """Return the size of a fault of this kind at which it shifts a print by ``effect_mm``."""
    unit = NamedFault(fault.part, fault.kind, 1.0, 0.1, fault.unit, "")
    return effect_mm / max(advise(unit).effect_mm, 1e-9)


def _seconds(text: str) -> float:
    when = datetime.fromisoformat(text)
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _iso(time_s: float | None) -> str | None:
    return None if time_s is None else datetime.fromtimestamp(time_s, UTC).date().isoformat()


def _month(time_s: float) -> str:
    when = datetime.fromtimestamp(time_s, UTC)
    return say(f"month-{when.month}", when.year)


def draw_history(path: Path, trends: Sequence[Trend], tell: Tell = str) -> None:
    """Draw the worst faults over time into a PNG; ``tell`` translates the words."""
    from printmend.draw.figure import PALETTE, draw_wear, new_figure, save

    shown = trends[:MOST_DRAWN]
    figure, axes = new_figure(max(len(shown), 1), width_in=4.6, height_in=3.8)
    for one, trend, colour in zip(axes, shown, PALETTE, strict=False):
        draw_wear(one, _drawn(trend), colour, tell)
    if not shown:
        axes[0].set_title(tell(say("wear-none")))
        axes[0].axis("off")
    figure.tight_layout()
    save(figure, path)


def _drawn(trend: Trend) -> "Wear":
    """Return the contents of a fault's picture, with the sizes that it has passed or will reach."""
    from printmend.draw.figure import Wear

    last, line, reached = trend.sizes[-1].time_s, None, None
    farthest = last + DRAWN_YEARS * YEAR_S
    if trend.is_sure:
        ends = trend.sizes[trend.since].time_s, min(trend.crossing_s or last, farthest)
        low, high = (trend.fault.value + trend.per_month * (end - last) / MONTH_S for end in ends)
        line = (ends[0], low), (ends[1], high)
    if trend.earliest_s is not None and trend.earliest_s < farthest:
        reached = trend.earliest_s, min(trend.latest_s or farthest, farthest)
    levels = [] if trend.crossing_s is None else [(trend.level, trend.effect_mm)]
    if trend.passed is not None:
        levels.insert(0, (trend.passed.level, trend.passed.effect_mm))
    unit, sizes = trend.fault.unit, trend.sizes
    return Wear(
        trend.name, unit, [one.time_s for one in sizes], [one.value for one in sizes], [one.sd for one in sizes], line,
        [(level, say("wear-level", f"{level:.2f}", unit, f"{effect_mm:g}")) for level, effect_mm in levels],
        None if trend.passed is None else trend.passed.when_s, reached,
    )  # fmt: skip


def rows_of(events: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Return (date, event, result) for every event, for a table."""
    rows: list[tuple[str, str, str]] = []
    for event in events:
        if event.get("event") == "verified":
            at_most = event.get("now_at_most_mm")
            now = f"{event['now_mm']:.3f}" if not isinstance(at_most, float) else say("less-than", f"{at_most:.3f}")
            promised = (f"{event[f'promised_{end}_mm']:.3f}" for end in ("low", "high"))
            said = say("history-verified", now, *promised, _said(str(event.get("result", ""))))
        elif event.get("event") == "refitted":
            said = say("history-refitted", " + ".join(map(str, event.get("motors", []))))
        else:
            faults = [
                say(
                    "history-grown",
                    part_words(one["part"]),
                    kind_words(one["kind"]),
                    f"{abs(one['value']):.3f} {one['unit']}",
                )
                for one in event.get("faults", event.get("heights", []))
            ]
            said = together("; ", faults) if faults else say("history-healthy")
        rows.append((_iso(event["seconds"]) or "", _said(str(event.get("event", ""))), said))
    return rows


def _said(name: str) -> str:
    """Return the message for an event or a result; an unknown name stays as it is."""
    return say(_MESSAGES[name]) if name in _MESSAGES else name
