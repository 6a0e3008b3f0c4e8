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
from printmend.promise.belief import parse_belief

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
    least, _ = _planned(file, model, coarsest, roles)
    if least > limit:
        if not force:
            raise RefusedError(
                file.name, wanted=say("at-most-more-time", f"{100 * limit:g}"),
                came=say("share-with-coarsest", f"{100 * least:.1f}"), todo=say("allow-more-or-force"),
            )  # fmt: skip
        return coarsest, say("takes-longer-though", f"{100 * least:.1f}", _words(coarsest, roles))
    for _ in range(_TRIALS):
        ease = float(np.sqrt((1.0 + low) * (1.0 + high))) - 1.0
        share, _ = _planned(file, model, replace(fineness, ease=ease), roles)
        if share > limit:
            low = ease
            continue
        high = ease
        if share > (1.0 - _NEAR_SHARE) * limit:
            break
    found = replace(fineness, ease=high)
    return found, say("to-take-no-longer", _words(found, roles))


def with_few_moves(file: GcodeFile, model: SavedModel, fineness: Fineness) -> tuple[Fineness, str | None]:
    """Return the fineness for a machine with ripple that at most doubles the moves, if that costs an outer wall no more
    than a quarter of the tolerance, and words about it.

    A ripple of hundredths of a millimetre bends every line several times a millimetre. Walls show it, infill does not.
    """
    roles, uneven = set[int](), replace(fineness, evenly=False)  # a wall that keeps its width needs its moves
    if not _ripples(model) or _planned(file, model, uneven, roles)[1] <= MOST_MOVES:
        return fineness, None
    low, high = 0.0, _MOST_EASE
    if _planned(file, model, replace(uneven, ease=high), roles)[1] <= MOST_MOVES:
        for _ in range(_FEW_TRIALS):
            ease = (low + high) / 2
            many = _planned(file, model, replace(uneven, ease=ease), roles)[1] > MOST_MOVES
            low, high = (ease, high) if many else (low, ease)
    found = replace(fineness, ease=high)
    return found, say("to-have-few-moves", _words(found, roles))


def _ripples(model: SavedModel) -> bool:
    """Say whether a model has a ripple that acts."""
    belief = parse_belief(model)
    return belief is not None and any(part.acts_mm.any() for part in belief.of("teeth"))


def _planned(file: GcodeFile, model: SavedModel, fineness: Fineness, roles: set[int]) -> tuple[float, float]:
    """Return the share of added time at a fineness, and how many moves a move becomes; add the roles of the lines
    found."""
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
    return after_s / before_s - 1.0 if before_s > 0.0 else 0.0, moves


def _words(fineness: Fineness, roles: set[int]) -> str:
    """Say how far lines may be off."""
    tolerances = fineness.tolerances_mm
    drawn = [(say(name), f"{tolerances[role]:.3f}") for role, name in _NAMES.items() if role in roles]
    return say("lines-less-closely", together(", ", [say("role-within", *each) for each in drawn]))
