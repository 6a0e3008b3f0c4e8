"""The budget of a model: all that it does not know, as values, as a section of its file, as errors along a path.

Type A, from the scatter of the measurement: the covariance C ≈ F Fᵀ of each motor's parameters, kept as the few
directions F in which the machine on the bed may differ; and what the residuals leave unexplained. Type B, from
elsewhere: the instrument (scale, difference of its axes, lean) and half a micro-step (JCGM 100:2008, 4.2 and 4.3).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.promise.effects import Effect, parse_effects
from printmend.saved import CROSS, SCALE_MM, Design, SavedModel, ScrewSeries, screw_of
from printmend.saved.values import LARGEST, number, numbers, refuse, section_of

VERSION = 1  # of the model file's section
DIRECTIONS = 48  # of a motor's parameters that are kept at most
_MOST_PARAMETERS = 400  # of a motor that a file may name, and most of its directions
LAYOUT = ("mean_harmonics", "play_harmonics", "elastic_harmonics", "ripple", "second_harmonics")


@dataclass(frozen=True, eq=False)
class MotorBudget:
    """What is not known of one motor: its parameters may be off by ``factor_mm`` [P, R] @ z, z ~ N(0, 1).

    ``seen`` is the share of its turn that was measured: the rest is a guess, and so is how good it is.
    ``left_out`` are the numbers of the last directions, and the chance p that they are there at all: each a part that
    the fit left out. Their factors are √p of what the part does, so that F Fᵀ is the variance of all. With ``machines``
    the factors are no directions but R machines that the measurement allows, each as likely: z is 1 for one of them.
    ``design`` says which parameters there are; ``reach_mm`` beyond which powers above the first go on straight.
    ``unexplained_mm2`` and ``unexplained_sd_mm2`` are the variance of what no parameter follows, and its doubt.
    """

    design: Design
    factor_mm: np.ndarray
    period_mm: float
    middle_mm: float
    reach_mm: tuple[float, float]
    unexplained_mm2: float
    unexplained_sd_mm2: float
    seen: float = 1.0
    left_out: tuple[tuple[int, float], ...] = ()
    machines: bool = False

    def columns(self, motor_mm: np.ndarray, own_mm: np.ndarray, other_mm: np.ndarray, side: np.ndarray) -> np.ndarray:
        """Return by how much the belt would be off for each of the R directions [N, R].

        The motor is at ``motor_mm`` [N], the belts ``own_mm`` and ``other_mm`` [N] from the bed's middle; ``side`` [N]
        is +1 where the motor pushes the belt forwards, −1 back, 0 between the two.
        """
        mean, play = self.design.columns(motor_mm, self.period_mm, self.middle_mm)
        inside = (np.clip(motor_mm, *self.reach_mm) - self.middle_mm) / SCALE_MM
        for table, name in ((mean, "mean_powers"), (play, "play_powers")):
            part = self.design.parts[name]
            for power in range(2, part.stop - part.start):
                table[:, part.start + power] = inside**power
        play *= 0.5 * side[:, None]
        moved = mean - play
        place = self.design.parts["cross"]
        for at, (p, q) in enumerate(self.design.cross, start=place.start):
            moved[:, at] = (own_mm / SCALE_MM) ** p * (other_mm / SCALE_MM) ** q
        return np.asarray(moved @ self.factor_mm)


@dataclass(frozen=True, eq=False)
class Budget:
    """What is not known of a machine.

    ``placed``: the measurement says where on the bed things lie; else errors are counted from home. ``stretch`` are
    weighed Gaussians of how the bed may be stretched beyond what acts, because the instrument cannot tell: (weight,
    mean [3], covariance [3, 3]) of common scale, half the difference of both axes' scales, half the skew [rad]; empty
    where the instrument is exact. ``effects`` are what the tests of misfit found. ``screw`` is the learned one of Z,
    which says how sure its push is; None without one. ``together``: the motors' machines and the stretches were drawn
    as whole printers, so that one of each belongs to one of the others.
    """

    motors: tuple[MotorBudget, MotorBudget]
    placed: bool
    stretch: tuple[tuple[float, np.ndarray, np.ndarray], ...]
    effects: tuple[Effect, ...]
    screw: ScrewSeries | None = None
    together: bool = False

    @property
    def turns_mm(self) -> tuple[float, float]:
        """The lengths of both motors' turns as they were learned."""
        return (self.motors[0].period_mm, self.motors[1].period_mm)


def parse_budget(model: SavedModel) -> Budget | None:
    """Return what a saved model says about its own doubt, None for one that says nothing.

    Raises `ModelError` for a section that is none of ours.
    """
    section = model.document.get("promise")
    if section is None:
        return None
    subject = "the model [promise]"
    if not isinstance(section, dict) or section.get("version") != VERSION:
        refuse(subject, f"a section of version {VERSION}", "something else")
    motors = section_of(section, "motors", dict, subject)
    if sorted(motors) != sorted(model.printer.motors):
        refuse(subject, f"motors {' and '.join(model.printer.motors)}", "others")
    parsed = [_motor(motors[name], f"{subject} {name}") for name in model.printer.motors]
    stretch, together = _stretch(section, subject), bool(section.get("together"))
    counts = {len(stretch), *(each.factor_mm.shape[1] for each in parsed)}
    if together and (len(counts) != 1 or not all(each.machines for each in parsed)):
        refuse(subject, "the same number of machines throughout", "others")
    return Budget(
        (parsed[0], parsed[1]), bool(section.get("placed")), stretch, parse_effects(model.document), screw_of(model),
        together,
    )  # fmt: skip


def _stretch(section: dict[str, Any], subject: str) -> tuple[tuple[float, np.ndarray, np.ndarray], ...]:
    found = []
    for one in section_of(section, "stretch", list, subject) if "stretch" in section else []:
        if not isinstance(one, dict):
            refuse(subject, "stretches as weight, mean and covariance", "something else")
        rows = section_of(one, "covariance", list, subject)
        weight, mean = number(one, "weight", subject), numbers(one, "mean", subject, 3)
        covariance = np.array([numbers({"row": row}, "row", subject, 3) for row in rows])
        if weight < 0 or mean.shape != (3,) or covariance.shape != (3, 3):
            refuse(subject, "stretches as weight, mean [3] and covariance [3, 3]", "something else")
        found.append((weight, mean, covariance))
    return tuple(found)


def _motor(section: Any, subject: str) -> MotorBudget:
    if not isinstance(section, dict):
        refuse(subject, "a section", "something else")
    layout = section_of(section, "parameters", dict, subject)
    counts = {name: int(number(layout, name, subject)) for name in ("mean_powers", "play_powers", "cross", "warp")}
    waves = {name: numbers(layout, name, subject, _MOST_PARAMETERS) for name in LAYOUT if name in layout}
    if not all(0 <= value <= _MOST_PARAMETERS for value in counts.values()) or counts["cross"] > len(CROSS):
        refuse(subject, "counts of parameters", "others")
    if any((each < 1).any() or (each % 1).any() for each in waves.values()):
        refuse(subject, "whole harmonics", "others")
    span = numbers(layout, "warp_span_mm", subject, 2)
    reach = numbers(section, "reach_mm", subject, 2)
    period_mm = number(section, "period_mm", subject)
    second_mm = number(layout, "second_mm", subject) if "second_harmonics" in waves else 0.0
    if len(span) != 2 or span[0] >= span[1] or len(reach) != 2 or reach[0] > reach[1] or period_mm <= 0:
        refuse(subject, "a positive period_mm and spans that rise", "something else")
    if "second_harmonics" in waves and second_mm <= 0:
        refuse(subject, "a positive second_mm", f"{second_mm:g}")
    design = Design(
        mean_powers=counts["mean_powers"],
        play_powers=counts["play_powers"],
        cross=CROSS[: counts["cross"]],
        warp=counts["warp"],
        warp_span_mm=(float(span[0]), float(span[1])),
        second_mm=second_mm,
        **{name: tuple(int(k) for k in each) for name, each in waves.items()},
    )
    factor = _factor(section_of(section, "factor_mm", dict, subject), design, subject)
    return MotorBudget(
        design,
        factor,
        period_mm,
        number(section, "middle_mm", subject),
        (float(reach[0]), float(reach[1])),
        abs(number(section, "unexplained_mm2", subject, LARGEST**2)),
        abs(number(section, "unexplained_sd_mm2", subject, LARGEST**2)),
        number(section, "seen", subject) if "seen" in section else 1.0,
        _left_out(section, factor.shape[1], subject),
        bool(section.get("machines")),
    )


def _left_out(section: dict[str, Any], directions: int, subject: str) -> tuple[tuple[int, float], ...]:
    rows = section_of(section, "left_out", list, subject) if "left_out" in section else []
    found = [numbers({"row": row}, "row", subject, 2) for row in rows]
    if any(len(each) != 2 or each[0] < 1 or each[0] % 1 or not 0 < each[1] <= 1 for each in found):
        refuse(subject, "numbers of directions with their chances", "something else")
    if sum(each[0] for each in found) > directions:
        refuse(subject, f"parts left out with at most {directions} directions", "more")
    return tuple((int(count), float(chance)) for count, chance in found)


def _factor(tables: dict[str, Any], design: Design, subject: str) -> np.ndarray:
    rows: dict[int, np.ndarray] = {}
    for name, table in tables.items():
        part = design.parts.get(name)
        if part is None or not isinstance(table, list) or len(table) != part.stop - part.start:
            refuse(subject, "a factor for each parameter", "something else")
        for i, row in enumerate(table):
            rows[part.start + i] = numbers({"row": row}, "row", subject, _MOST_PARAMETERS)
    widths = {len(row) for row in rows.values()}
    if len(widths) > 1:
        refuse(subject, "factors of one length", "several")
    factor = np.zeros((design.size, widths.pop() if widths else 0))
    for at, row in rows.items():
        factor[at] = row
    return factor
