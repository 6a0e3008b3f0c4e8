"""`printmend bench real`: learn from the first measured traverse of each direction, predict the later ones.

Two protocols. ``first`` learns from the first traverse of each direction of a file and predicts all the others.
``recording`` does so for each of a file's two recordings by itself: the carriage was brought back between them, and
the raw speeds show that the first always ran at the slowest speed.

The floor is what no predictor can pass: the scatter of the later traverses about their own mean. Each figure comes
twice: ``blind``, with travel counted from each traverse's first sample as recorded, and ``aligned``, counted from the
commanded geometry (`starts_mm`), which uses the lengths of the later traverses but never their errors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.bench.periodic import fit
from printmend.bench.traverse import Traverse, detrended, starts_mm
from printmend.errors import TraceError

RealProtocol = Literal["first", "recording"]
PROTOCOLS: tuple[RealProtocol, ...] = ("first", "recording")


@dataclass(frozen=True)
class RealLine:
    """One shape and speed: root mean squares [mm] over the later traverses of both directions.

    ``plain`` is the reference, a least-squares fit of eight harmonics a direction, the travel of a turn fitted too;
    ``turn_mm`` is the learned travel of a turn, ``shared`` how far the directions share their pulley (1: wholly).
    """

    protocol: RealProtocol
    shape: str
    speed_mm_s: float
    later: int
    raw_mm: float
    plain_blind_mm: float
    plain_aligned_mm: float
    blind_mm: float
    aligned_mm: float
    floor_blind_mm: float
    floor_aligned_mm: float
    turn_mm: float
    shared: float


HEADER = ("pulley", "mm/s", "later", "raw mm", "plain", "ours", "floor", "plain aligned", "ours aligned",
          "floor aligned", "raw÷ours", "raw÷ours aligned", "raw÷floor aligned", "turn mm")  # fmt: skip


def real_lines(
    traverses: Sequence[Traverse], protocol: RealProtocol, *, tick: Callable[[str], None] = lambda name: None
) -> list[RealLine]:
    """Evaluate every shape and speed; calls ``tick`` with each name. Raise `TraceError` for too few traverses."""
    keys = list(dict.fromkeys((item.shape, item.speed_mm_s) for item in traverses))
    lines = []
    for shape, speed in keys:
        mine = [item for item in traverses if (item.shape, item.speed_mm_s) == (shape, speed)]
        groups = [mine] if protocol == "first" else [[t for t in mine if t.recording == n] for n in (0, 1)]
        lines.append(_line(protocol, [group for group in groups if group]))
        tick(f"{shape} {speed:g}")
    return lines


def _line(protocol: RealProtocol, groups: list[list[Traverse]]) -> RealLine:
    with threadpool_limits(1, user_api="blas"):  # small systems: a second thread only waits
        return _evaluated(protocol, groups)


def _evaluated(protocol: RealProtocol, groups: list[list[Traverse]]) -> RealLine:
    sums: dict[str, list[float]] = {}
    models, later = [], 0
    for group in groups:
        sides = {sign: [item for item in group if item.direction == sign] for sign in (1, -1)}
        if min(map(len, sides.values())) < 3:
            raise TraceError(
                f"{group[0].shape} {group[0].speed_mm_s:g} mm/s",
                wanted="three traverses in each direction: one to learn from, two to predict",
                came=" and ".join(str(len(side)) for side in sides.values()),
                todo="use --protocol first, or leave this pulley out",
            )
        forth, back = sides[1][0], sides[-1][0]
        model = fit(forth.travel_mm, forth.error_mm, back.travel_mm, back.error_mm)
        models.append(model)
        for sign, side in sides.items():
            starts = starts_mm(side)
            plain = plain_fit(side[0])
            for item, start in zip(side[1:], starts[1:], strict=True):
                later += 1
                travel, error = item.travel_mm, item.error_mm
                sums.setdefault("raw_mm", []).append(float((error**2).mean()))
                for name, at in (("blind", travel), ("aligned", travel + start)):
                    for label, predicted in (
                        (f"plain_{name}_mm", plain(at)),
                        (f"{name}_mm", model.error_mm(sign, at)),
                    ):
                        residual = error - detrended(travel, predicted)
                        sums.setdefault(label, []).append(float((residual**2).mean()))
            sums.setdefault("floor_blind_mm", []).append(scatter_mm2(side[1:], np.zeros(len(side) - 1)))
            sums.setdefault("floor_aligned_mm", []).append(scatter_mm2(side[1:], starts[1:]))
    first = groups[0][0]
    means = {name: float(np.sqrt(np.mean(values))) for name, values in sums.items()}
    turn, shared = (float(np.mean([getattr(m, name) for m in models])) for name in ("turn_mm", "shared"))
    return RealLine(protocol, first.shape, first.speed_mm_s, later, turn_mm=turn, shared=shared, **means)


def plain_fit(traverse: Traverse, *, harmonics: int = 8) -> Callable[[np.ndarray], np.ndarray]:
    """Return the least-squares harmonics of one traverse as a function of travel [N] mm: the reference.

    The travel of a turn is the best of 36 to 48 mm in steps of 0.1.
    """

    def columns(travel_mm: np.ndarray, turn_mm: float) -> np.ndarray:
        angle = np.outer(travel_mm, np.arange(1, harmonics + 1)) * (2 * np.pi / turn_mm)
        line = np.stack([np.ones_like(travel_mm), travel_mm], axis=1)
        return np.concatenate([line, np.cos(angle), np.sin(angle)], axis=1)

    def fitted(turn_mm: float) -> tuple[float, float, np.ndarray]:
        design = columns(traverse.travel_mm, turn_mm)
        weights = np.linalg.lstsq(design, traverse.error_mm, rcond=None)[0]
        return float(((traverse.error_mm - design @ weights) ** 2).sum()), turn_mm, weights

    _, turn, weights = min((fitted(turn) for turn in np.arange(36.0, 48.05, 0.1)), key=lambda found: found[0])
    return lambda at: columns(at, turn) @ weights


def scatter_mm2(traverses: Sequence[Traverse], starts: np.ndarray) -> float:
    """Return the unbiased variance [mm²] of full traverses about their mean, over the travel that they share."""
    longest = max(item.length_mm for item in traverses)
    full = [(t, start) for t, start in zip(traverses, starts, strict=True) if t.length_mm > 0.95 * longest]
    travel = np.arange(max(start for _, start in full), min(item.length_mm + start for item, start in full) + 1e-9, 0.5)
    errors = [detrended(travel, np.interp(travel, item.travel_mm + start, item.error_mm)) for item, start in full]
    return float(np.var(errors, axis=0, ddof=1).mean())


def cells(line: RealLine) -> tuple[str, ...]:
    """Return a line as the table's texts, in the order of `HEADER`."""
    sizes = (line.raw_mm, line.plain_blind_mm, line.blind_mm, line.floor_blind_mm, line.plain_aligned_mm,
             line.aligned_mm, line.floor_aligned_mm)  # fmt: skip
    ratios = (line.raw_mm / line.blind_mm, line.raw_mm / line.aligned_mm, line.raw_mm / line.floor_aligned_mm)
    return (
        line.shape,
        f"{line.speed_mm_s:g}",
        str(line.later),
        *(f"{size:.3f}" for size in sizes),
        *(f"{ratio:.2f}" for ratio in ratios),
        f"{line.turn_mm:.2f}",
    )
