"""Report about a scanned part: its sizes, and the settings for each slicer."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from printmend.fit.estimate import RANGE, Estimate, Side
from printmend.fit.setting import SLICERS, Setting, Slicer, Wanted, flow_instead
from printmend.gcode.sliced import Sliced
from printmend.messages import say, say_count

MOST_HOLES = 12  # most holes in the report; --json has all
REPEAT_SD_MM = 0.01  # standard deviation of a wall from print to print


def _pm(value_mm: float, sd_mm: float, *, sign: bool = False) -> str:
    return f"{value_mm:{'+' if sign else ''}.2f} ± {max(RANGE * sd_mm, 0.01):.2f} mm"


def fit_words(
    estimate: Estimate, file: Sliced, corrections: Wanted, settings: Mapping[str, Sequence[Setting]], *,
    filament: str | None, height_mm: float, slicers: Sequence[str] | None = None,
) -> list[str]:  # fmt: skip
    """Return the report for a terminal: sizes, causes, settings. A ± is half of a 90 % range."""
    lines: list[str] = [say("fit-title"), *_picture_lines(estimate)]
    own = SLICERS.get(file.maker, SLICERS["orcaslicer"])
    for side in estimate.sides:
        lines += _size_lines(side, estimate, file, corrections, own)
    lines += _cause_lines(estimate, file, filament, height_mm)
    for name in slicers or ([file.maker] if file.maker in SLICERS else list(SLICERS)):
        lines.append(f"{SLICERS[name].title}:")
        lines += [
            say("fit-setting" if each.is_new else "fit-setting-unchanged", each.name, each.key, each.value)
            for each in settings[name]
        ]
        if name == "prusaslicer" and abs(corrections.hole_mm - corrections.outline_mm) >= 0.02:
            lines.append(say("fit-no-holes"))
    return lines


def fit_sizes(estimate: Estimate, file: Sliced, corrections: Wanted) -> list[str]:
    """Return only the sizes, for the end of `measure`."""
    own = SLICERS.get(file.maker, SLICERS["orcaslicer"])
    lines: list[str] = [say("fit-title-sizes"), *_picture_lines(estimate)]
    return lines + [line for side in estimate.sides for line in _size_lines(side, estimate, file, corrections, own)]


def _picture_lines(estimate: Estimate) -> list[str]:
    """Say that the sizes are those in a picture of an unknown size."""
    return [say("fit-in-picture")] if estimate.shown else []


def _layer_words(side: Side) -> str:
    return say("fit-first-layer") if side.layer == 1 else say("fit-layer", side.layer)


def after_hole_mm(
    side: Side, number: int, estimate: Estimate, file: Sliced, corrections: Wanted, slicer: Slicer
) -> tuple[float, float]:
    """Return a round hole's diameter as it was drawn, and as it comes out with a slicer's settings."""
    hole, held = side.rounds[number], slicer.holds(corrections)
    foot = held.foot_mm if side.layer == 1 else 0.0
    drawn = (hole.at.diameter_mm + 2 * file.outward_mm(hole=True, layer=side.layer)) * (1 - file.shrinkage)
    scale = sum(estimate.shown or estimate.scale) / 2
    cut = drawn / (1 - held.shrinkage) - 2 * (held.hole_mm - foot)
    return drawn, cut * (1 + scale) - 2 * ((side.hole_mm or 0.0) + hole.own_mm)


def after_size_mm(
    side: Side, axis: int, estimate: Estimate, file: Sliced, corrections: Wanted, slicer: Slicer
) -> tuple[float, float]:
    """Return a part's size along an axis as it was drawn, and as it comes out with a slicer's settings."""
    held = slicer.holds(corrections)
    foot = held.foot_mm if side.layer == 1 else 0.0
    drawn = (side.size_mm[axis] - 2 * file.outward_mm(hole=False, layer=side.layer)) * (1 - file.shrinkage)
    cut = drawn / (1 - held.shrinkage) + 2 * (held.outline_mm - foot)
    scale = (estimate.shown or estimate.scale)[axis]
    return drawn, cut * (1 + scale) + 2 * side.outline_mm


def _size_lines(side: Side, estimate: Estimate, file: Sliced, corrections: Wanted, slicer: Slicer) -> list[str]:
    lines: list[str] = []
    for axis, name in enumerate("XY"):
        drawn, after = after_size_mm(side, axis, estimate, file, corrections, slicer)
        now, sd = side.came_mm[axis], side.came_sd_mm[axis]
        sure = _pm(after, (sd**2 + REPEAT_SD_MM**2) ** 0.5)
        lines.append(say("fit-size", _layer_words(side), f"{drawn:.2f}", name, _pm(now, sd), sure))
    for number, hole in enumerate(side.rounds[:MOST_HOLES]):
        drawn, after = after_hole_mm(side, number, estimate, file, corrections, slicer)
        sure = _pm(after, (hole.sd_mm**2 + REPEAT_SD_MM**2) ** 0.5)
        place = (f"{hole.at.x_mm:.0f}", f"{hole.at.y_mm:.0f}")
        came = _pm(hole.diameter_mm, hole.sd_mm)
        lines.append(say("fit-hole", _layer_words(side), f"{drawn:.2f}", *place, came, sure))
    if more := len(side.rounds) - MOST_HOLES:
        lines += [say_count("terminal-fit-more-holes", more)] if more > 0 else []
    return lines


def _cause_lines(estimate: Estimate, file: Sliced, filament: str | None, height_mm: float) -> list[str]:
    lines: list[str] = [say("fit-causes")]
    for side in estimate.sides:
        words = say("fit-outline", _layer_words(side), _pm(side.outline_mm, side.outline_sd_mm, sign=True))
        if side.hole_mm is not None:
            words = say("fit-narrower", words, _pm(side.hole_mm, side.hole_sd_mm, sign=True))
        lines.append(words)
    if (foot := estimate.foot_mm) is not None:
        lines.append(say("fit-foot", _pm(*foot, sign=True)))
    elif estimate.first is not None:
        lines.append(say("terminal-fit-foot-or-width"))
    else:
        lines.append(say("fit-foot-unseen"))
    if (upper := estimate.upper) is not None:
        came = upper.width_mm + 2 * upper.outline_mm
        words = say("fit-width", f"{upper.width_mm:.2f}", _pm(came, 2 * upper.outline_sd_mm))
        if (flow := flow_instead(upper.width_mm, came, file, height_mm)) is not None:
            words = say("fit-flow", words, f"{flow:.3f}")
        lines.append(words)
    whose = say("fit-shrinkage-of", filament) if filament else say("fit-shrinkage")
    if not estimate.is_machine_off:
        whose = say("fit-with-machine", whose)
    by = (
        say("fit-percent", f"{-100 * scale:+.2f} ± {100 * RANGE * sd:.2f} %", axis)
        for scale, sd, axis in zip(estimate.scale, estimate.scale_sd, "XY", strict=True)
    )
    lines.append(say("fit-shrinks", whose, *by))
    return lines


def fit_json(
    estimate: Estimate, file: Sliced, corrections: Wanted, settings: Mapping[str, Sequence[Setting]],
    filament: str | None,
) -> dict[str, Any]:  # fmt: skip
    """Return all numbers for programs; each ``range`` is half of a 90 % range."""

    def value(mean: float, sd: float) -> dict[str, float]:
        return {"value": round(mean, 4), "range": round(RANGE * sd, 4)}

    layers = []
    for side in estimate.sides:
        holes = []
        for number, hole in enumerate(side.rounds):
            after = {
                name: round(after_hole_mm(side, number, estimate, file, corrections, slicer)[1], 3)
                for name, slicer in SLICERS.items()
            }
            drawn = after_hole_mm(side, number, estimate, file, corrections, SLICERS["orcaslicer"])[0]
            holes.append({
                "x_mm": round(hole.at.x_mm, 2), "y_mm": round(hole.at.y_mm, 2), "drawn_mm": round(drawn, 3),
                "came_mm": value(hole.diameter_mm, hole.sd_mm), "after_mm": after,
            })  # fmt: skip
        layers.append({
            "layer": side.layer, "outline_mm": value(side.outline_mm, side.outline_sd_mm),
            "hole_mm": None if side.hole_mm is None else value(side.hole_mm, side.hole_sd_mm), "holes": holes,
            "size_mm": [round(each, 3) for each in side.size_mm],
            "came_mm": [value(*pair) for pair in zip(side.came_mm, side.came_sd_mm, strict=True)],
        })  # fmt: skip
    upper = estimate.upper
    return {
        "filament": filament,
        "machine_taken_off": estimate.is_machine_off,
        "sizes_in_picture": estimate.shown is not None,
        "shrinkage": {a: value(-s, sd) for a, s, sd in zip("xy", estimate.scale, estimate.scale_sd, strict=True)},
        "line_width_mm": None
        if upper is None
        else value(upper.width_mm + 2 * upper.outline_mm, 2 * upper.outline_sd_mm),
        "elephants_foot_mm": None if estimate.foot_mm is None else value(*estimate.foot_mm),
        "layers": layers,
        "corrections_mm": {key: round(each, 4) for key, each in asdict(corrections).items()},
        "settings": {
            name: {each.key: {"name": each.name, "value": each.value, "where": each.where, "is_new": each.is_new}
                   for each in rows}
            for name, rows in settings.items()
        },
    }  # fmt: skip
