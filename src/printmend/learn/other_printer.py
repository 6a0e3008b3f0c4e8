"""Whose print is it? A table may be of a printer with the other kinematics, or of one that homes elsewhere.

Pulleys and play of a printer with a motor for each axis go with x and y, those of a CoreXY with x + y and x − y: each
leaves much of what the other one does. So drives of the other kinematics, roughly learned, are a rival of the model
with all its effects, with odds of their own. A healthy printer's table could be either's.
"""

import math
from dataclasses import replace

import numpy as np

from printmend.effects.prior import share_of
from printmend.infer.fit import Fit
from printmend.infer.scatter import independent_share, robust_sigma_mm
from printmend.infer.search import LEAST_SIGMA_MM
from printmend.learn.order import roughly
from printmend.learn.rows import LEAST_ROWS
from printmend.measure.table import AT_HOME_MM
from printmend.messages import say
from printmend.metrics.robust import log_likelihood
from printmend.model.notes import NOTE, WARNING, Misfit
from printmend.path import Trace
from printmend.printer import Printer, preset_names, read_printer

SURE_ODDS = 19.0  # from which on an owner is asked whose table it is


def another_printers(fit: Fit, trace: Trace) -> tuple[Misfit, ...]:
    """Return a warning where a printer of the other kinematics explains a trace better than what was learned of it."""
    if trace.wall_rows.any():
        return ()
    is_corexy = fit.scene.corexy
    other = roughly(trace, replace(fit.scene.printer, kinematics="cartesian" if is_corexy else "corexy"))
    theirs_mm, ours_mm = other.left_by_mark_mm(trace), fit.left_by_mark_mm(trace)
    known = np.isfinite(theirs_mm + ours_mm).all(axis=1)
    if known.sum() < LEAST_ROWS:
        return ()
    their, our = (log_likelihood(each[known].ravel(), LEAST_SIGMA_MM) for each in (theirs_mm, ours_mm))
    share = min(independent_share(each, robust_sigma_mm(each)) for each in theirs_mm[known].T)
    nats = share * (their - our) + _of_set(other) - _of_set(fit) + math.log(share_of("other_printer"))
    if nats < math.log(SURE_ODDS):
        return ()
    their_mm, our_mm = (math.sqrt(2) * robust_sigma_mm(each[known]) for each in (theirs_mm, ours_mm))
    told = "table-looks-printer-motor-each-axis" if is_corexy else "table-looks-corexy-made-printer-motor"
    return (Misfit("printer", WARNING, our_mm, nats, say(told, f"{their_mm:.2f}", f"{our_mm:.2f}")),)


def _of_set(fit: Fit) -> float:
    """Return the logarithm of the odds of a fit's effects, less what their freedom costs."""
    gram, state = fit.search.gram, fit.state
    left = gram.square - gram.slope[state.columns] @ state.mean_mm
    return state.score + 0.5 * (gram.count * math.log(state.sigma_mm**2) + float(left) / state.sigma_mm**2)


def another_home(trace: Trace, printer: Printer) -> tuple[Misfit, ...]:
    """Return a note where a table begins, unmeasured, where other printers that come with the program home."""
    first = trace.commanded_mm[0]
    if trace.measured_rows[0] or _is_at(first, printer):
        return ()
    if not any(_is_at(first, read_printer(name)) for name in preset_names()):
        return ()
    words = say(
        "table-begins-where-other-printers-home",
        f"{first[0]:g}",
        f"{first[1]:g}",
        f"{printer.home_mm[0]:g}",
        f"{printer.home_mm[1]:g}",
    )
    return (Misfit("home", NOTE, 0.0, 0.0, words),)


def _is_at(place_mm: np.ndarray, printer: Printer) -> bool:
    return bool(np.abs(place_mm - np.array(printer.home_mm)).max() <= AT_HOME_MM)
