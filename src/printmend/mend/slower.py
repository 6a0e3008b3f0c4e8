"""Keep the added time and moves within a limit: draw the least important lines more coarsely until it holds."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from printmend.errors import RefusedError
from printmend.gcode import kernels as k
from printmend.gcode.container import GcodeFile
from printmend.gcode.write import Planned, follow
from printmend.mend.program import begun
from printmend.messages import say, together
from printmend.model.model import SavedModel
from printmend.plan import Fineness, start

_TRIALS = 6  # trials between an ease that is too slow and one that is not
MOST_MOVES = 2.0  # that a line may become, on average, for a ripple
_MOST_EASE = 1.0  # its price: lines without a type may be off twice as far, outer walls a quarter more
_FEW_TRIALS = 2
_NEAR_SHARE = 0.1  # stop trying within this share of the limit
_NAMES = {  # messages
    k.ROLE_ASIDE: "role-aside", k.ROLE_INFILL: "role-infill", k.ROLE_SOLID: "role-solid",
    k.ROLE_INNER: "role-inner", k.ROLE_UNKNOWN: "role-unknown", k.ROLE_OUTER: "role-outer",
}  # fmt: skip


def eased(file: GcodeFile, model: SavedModel, fineness: Fineness, *, force: bool) -> tuple[Fineness, str | None]:
    """Return the finest fineness that keeps a file's printing time within the limit, and words about it.

    Plans the file once if it is fast enough anyway, otherwise up to two times more than `_TRIALS`. Raises
    `RefusedError` if it is too slow even with the coarsest lines, unless ``force``.
    """
    assert fineness.slower is not None
    limit, roles = fineness.slower, set[int]()
    if _planned(file, model, fineness, roles)[0] <= limit:
        return fineness, None
    low, high = 0.0, fineness.most_ease
    coarsest = replace(fineness, ease=high)
    least, _, _ = _planned(file, model, coarsest, roles)
    if least > limit:
        if not force:
            raise RefusedError(
                file.name, wanted=say("at-most-more-time", f"{100 * limit:g}"),
                came=say("share-with-coarsest", f"{100 * least:.1f}"), todo=say("allow-more-or-force"),
            )  # fmt: skip
        return coarsest, say("takes-longer-though", f"{100 * least:.1f}", _words(coarsest, roles))
    for _ in range(_TRIALS):
        ease = float(np.sqrt((1.0 + low) * (1.0 + high))) - 1.0
        share, _, _ = _planned(file, model, replace(fineness, ease=ease), roles)
        if share > limit:
            low = ease
            continue
        high = ease
        if share > (1.0 - _NEAR_SHARE) * limit:
            break
    found = replace(fineness, ease=high)
    return found, say("to-take-no-longer", _words(found, roles))


def with_few_moves(file: GcodeFile, model: SavedModel, fineness: Fineness) -> tuple[Fineness, str | None]:
    """Return the fineness for a machine with ripple that at most doubles the moves, and words about it.

    It may cost an outer wall a quarter of the tolerance, and the file the whole tolerance in RMS.

    A ripple of hundredths of a millimetre bends every line several times a millimetre. Walls show it, infill does not.
    """
    roles, uneven = set[int](), replace(fineness, evenly=False)  # a wall that keeps its width needs its moves

    def drawn(ease: float) -> tuple[bool, bool]:
        """Say whether a file has few moves, and is drawn well."""
        _, moves, rms_mm = _planned(file, model, replace(uneven, ease=ease), roles)
        return moves <= MOST_MOVES, rms_mm <= fineness.tolerance_mm

    if not _ripples(model, fineness) or drawn(0.0)[0]:
        return fineness, None
    low, high = 0.0, _MOST_EASE
    few, well = drawn(high)
    if well and not few:
        low = high
    for _ in range(_FEW_TRIALS if few or not well else 0):
        ease = (low + high) / 2
        few_here, well_here = drawn(ease)
        if few_here or not well_here:
            high, well = ease, well_here
        else:
            low = ease
    found = replace(fineness, ease=high if well else low)
    return found, say("to-have-few-moves", _words(found, roles))


def _ripples(model: SavedModel, fineness: Fineness) -> bool:
    """Tell whether half of a motor's way bends so sharply that a millimetre of it strays by more than the tolerance."""
    head, tables = start(model.mechanism, tolerance_mm=fineness.tolerance_mm).model
    bends = [tables[first : first + last + 1] for first, last in zip(head.bend[:2], head.bend_last[:2], strict=True)]
    return any(float(np.median(bend)) / 8.0 > fineness.tolerance_mm for bend in bends)


def _planned(file: GcodeFile, model: SavedModel, fineness: Fineness, roles: set[int]) -> tuple[float, float, float]:
    """Return by which share a file takes longer when it is drawn in a way, how many moves a move becomes, and its error
    [mm RMS]; add the roles of its lines."""
    planner = start(model.mechanism, tolerance_mm=fineness.tolerance_mm)
    before_s = after_s = 0.0
    for part in file.parts:
        state, one = begun(part, planner, model, fineness)

        def look(planned: Planned, watch: Callable[[Planned], None] = one.watch.watch) -> None:
            flags = planned.records["flags"]
            roles.update(np.unique(flags[flags & k.FLAG_EXTRUDING > 0] >> k.ROLE_SHIFT & k.ROLE_MASK).tolist())
            watch(planned)

        follow(part.chunks(), state, planner.plan, look=look)
        one.watch.finish()
        before_s, after_s = before_s + one.watch.before.seconds, after_s + one.watch.after.seconds
    counts = planner.counts
    moves = float(counts.pieces + counts.copied) / max(float(counts.moves), 1.0)
    layers = planner.layers[: int(counts.layer) + 1]
    rms_mm = float(np.sqrt(layers["square"][:, 1].sum() / max(layers["length"].sum(), 1e-9)))
    return after_s / before_s - 1.0 if before_s > 0.0 else 0.0, moves, rms_mm


def _words(fineness: Fineness, roles: set[int]) -> str:
    """Say how far lines may be off."""
    tolerances = fineness.tolerances_mm
    drawn = [(say(name), f"{tolerances[role]:.3f}") for role, name in _NAMES.items() if role in roles]
    return say("lines-less-closely", together(", ", [say("role-within", *each) for each in drawn]))
