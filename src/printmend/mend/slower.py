"""Keep the added time within a limit: draw the least important lines more coarsely until it holds."""

from dataclasses import replace

import numpy as np

from printmend.errors import RefusedError
from printmend.gcode import kernels as k
from printmend.gcode.container import GcodeFile
from printmend.gcode.write import follow
from printmend.mend.program import begun
from printmend.messages import say, together
from printmend.model.model import SavedModel
from printmend.plan import Fineness, Planner, start

_TRIALS = 6  # trials between an ease that is too slow and one that is not
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
    limit = fineness.slower
    if _planned(file, model, fineness)[0] <= limit:
        return fineness, None
    low, high = 0.0, fineness.most_ease
    coarsest = replace(fineness, ease=high)
    least, found = _planned(file, model, coarsest)
    if least > limit:
        if not force:
            raise RefusedError(
                file.name, wanted=say("at-most-more-time", f"{100 * limit:g}"),
                came=say("share-with-coarsest", f"{100 * least:.1f}"), todo=say("allow-more-or-force"),
            )  # fmt: skip
        return coarsest, say("takes-longer-though", f"{100 * least:.1f}", coarser(found))
    for _ in range(_TRIALS):
        ease = float(np.sqrt((1.0 + low) * (1.0 + high))) - 1.0
        share, planner = _planned(file, model, replace(fineness, ease=ease))
        if share > limit:
            low = ease
            continue
        high, found = ease, planner
        if share > (1.0 - _NEAR_SHARE) * limit:
            break
    return replace(fineness, ease=high), say("to-take-no-longer", coarser(found))


def few_moves_words(planner: Planner) -> str | None:
    """Say how far the lines of a file may be off, where a machine bends so sharply that walls would take many moves."""
    head = planner.model.head
    return say("to-have-few-moves", coarser(planner)) if head.chords[k.ROLE_OUTER] > head.chords[-1] else None


def _planned(file: GcodeFile, model: SavedModel, fineness: Fineness) -> tuple[float, Planner]:
    """Return the share of added time at a fineness, and the planner that knows how its lines are drawn."""
    planner = start(model.mechanism, tolerance_mm=fineness.tolerance_mm)
    before_s = after_s = 0.0
    for part in file.parts:
        state, one = begun(part, planner, model, fineness)
        follow(part.chunks(), state, planner.plan, look=one.watch.watch)
        one.watch.finish()
        before_s, after_s = before_s + one.watch.before.seconds, after_s + one.watch.after.seconds
    return after_s / before_s - 1.0 if before_s > 0.0 else 0.0, planner


def coarser(planner: Planner) -> str:
    """Say how far the lines of a file may be off."""
    mm, roles = planner.tolerances_mm, int(planner.counts.roles)
    drawn = [(say(name), f"{mm[role]:.3f}") for role, name in _NAMES.items() if roles >> role & 1]
    return say("lines-less-closely", together(", ", [say("role-within", *each) for each in drawn]))
