"""Choose the simplest drive that a motor's rows support: the nested list of physics.md §4, by Laplace evidence.

{healthy} < {offset, scale} < {+ Fourier} < {+ play, or a loose belt} < {+ play that follows the angle or the position}
< {+ odd harmonics × position, ripple, bent guides}: every part must pay for itself, else it is switched off.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.worldmodel.greybox_design import Design, Normal, Rows
from printmend.worldmodel.greybox_fit import Fit, Posterior, Prior, refine, solve

COARSE_HARMONICS = 8
TRIAL_HARMONICS = 16
HARMONICS = 32
WORTH = 6.0  # nats of evidence that a part must bring
SURE_PLAY = 3.0  # play above so many standard deviations of one point cannot be adapted noise
WORTH_PLAY = 10.0  # play also adapts the contacts to the noise, which the evidence does not see
STARTS_MM = (0.3, 3.0)
CROSS = ((0, 1), (0, 2), (1, 1), (0, 3), (1, 2), (2, 1))
ELASTIC = (1, 3, 5)


@dataclass(frozen=True)
class Structure:
    """Which parts of a drive there are.

    ``cross`` is the highest order of the frame's terms, ``pulley`` the harmonics of the mean (none, even, all),
    ``play`` none, constant, loose (odd harmonics on top) or free (all harmonics).
    """

    offset: bool = True
    scale: bool = True
    drift: bool = False
    cross: int = 1
    ripple: bool = False
    pulley: str = "all"
    play: str = "constant"
    friction: bool = False
    elastic: bool = False

    @property
    def is_healthy(self) -> bool:
        return self == NOTHING

    def active(self, design: Design) -> np.ndarray:
        """Mark the parameters [P] of ``design`` that are on."""
        odd = design.harmonic % 2 == 1
        parts, on = design.parts, np.zeros(design.size, bool)
        on[parts["start"]] = True
        on[parts["mean_powers"]] = np.array([self.offset, self.scale, self.drift, self.drift])[: design.mean_powers]
        played = self.play != "none"
        on[parts["play_powers"]] = np.array([played, self.friction, self.friction])[: design.play_powers] & played
        on[parts["cross"]] = [p + q <= self.cross for p, q in design.cross]
        on |= design.mask("ripple") & self.ripple
        on |= design.mask("mean") & {"none": False, "even": ~odd, "all": True}[self.pulley]
        on |= design.mask("play") & {"none": False, "constant": False, "loose": odd, "free": True}[self.play]
        on |= design.mask("elastic") & self.elastic
        return on

    def design(self, harmonics: int, ripple: tuple[int, ...]) -> Design:
        """Return the columns of these parts only, with that many harmonics."""
        waves = tuple(range(1, harmonics + 1))
        even, odd = waves[1::2], waves[::2]
        return Design(
            mean_powers=4 if self.drift else 2 if self.scale else int(self.offset),
            play_powers=0 if self.play == "none" else 3 if self.friction else 1,
            cross=tuple((p, q) for p, q in CROSS if p + q <= self.cross),
            ripple=ripple if self.ripple else (),
            mean_harmonics={"none": (), "even": even, "all": waves}[self.pulley],
            play_harmonics={"none": (), "constant": (), "loose": odd, "free": waves}[self.play],
            elastic_harmonics=ELASTIC if self.elastic else (),
        )


NOTHING = Structure(offset=False, scale=False, cross=0, pulley="none", play="none")
EVERYTHING = Structure(drift=True, cross=3, ripple=True, play="free", friction=True, elastic=True)
TAUT = replace(EVERYTHING, play="none", friction=False)


@dataclass(frozen=True, eq=False)
class Choice:
    """A structure, its columns and its fit."""

    structure: Structure
    design: Design
    fit: Fit


def search(rows: Rows) -> Choice:
    """Find the contacts with few harmonics from several starts; return the best of the drive's main structures."""
    design = Structure(play="free").design(COARSE_HARMONICS, ())
    place = design.parts["play_powers"]

    def tried(play: str, pulley: str, start_mm: float) -> Choice:
        structure, values = Structure(pulley=pulley, play=play), np.zeros(design.size)
        values[place] = start_mm
        active = structure.active(design)
        fit = refine(design, rows, values, active, prior=Prior(), passes=12, rounds=1, patience=2, drop=False)
        return Choice(structure, design, fit)

    played = min((tried("constant", "all", start_mm) for start_mm in STARTS_MM), key=lambda choice: choice.fit.loss_mm)
    play_mm = float(played.fit.posterior.values[place][0])
    best = tried("none", "all", 0.0)
    for choice in (played, tried("loose", "even", play_mm), tried("free", "all", play_mm)):
        if choice.fit.loss_mm < best.fit.loss_mm * (0.98 if choice.structure.play == "free" else 0.999):
            best = choice
    return best


def refined(rows: Rows, found: Choice) -> Choice:
    """Repeat a search's fit on rows that hardly differ."""
    post = found.fit.posterior
    active = found.structure.active(found.design)
    fit = refine(found.design, rows, post.values, active, prior=post.prior, passes=3, rounds=1, drop=False)
    return Choice(found.structure, found.design, fit)


def prune(rows: Rows, found: Choice, ripple: tuple[int, ...]) -> Structure:
    """Fit everything at once, then drop, part by part, what does not pay.

    Contacts adapt to the play that a model has, so a taut machine is fitted with contacts of its own before play is
    preferred to it: at the other's contacts it would look worse than it is.
    """
    design = EVERYTHING.design(TRIAL_HARMONICS, ripple)
    values = design.moved(found.fit.posterior.values, found.design)
    played, full = _pruned(rows, design, EVERYTHING, values, found.fit.posterior.prior)
    play_mm = full.posterior.values[design.parts["play_powers"]][0]
    if played.play == "none" or play_mm > SURE_PLAY * full.posterior.sigma_mm:
        return played
    values = full.posterior.values * TAUT.active(design)
    taut, loser = _pruned(rows, design, TAUT, values, full.posterior.prior)
    share = full.share
    ours, theirs = (
        _evidence(rows, design, structure, fit, share) for structure, fit in ((played, full), (taut, loser))
    )
    return played if ours > theirs + WORTH_PLAY else taut


def _evidence(rows: Rows, design: Design, structure: Structure, start: Fit, share: float) -> float:
    """Return the log evidence of a structure with contacts of its own."""
    active, post = structure.active(design), start.posterior
    fit = refine(design, rows, post.values * active, active, prior=post.prior, passes=3, rounds=2)
    return _posterior(design, fit.normal.tempered(share), structure, fit.posterior).log_evidence


def _pruned(rows: Rows, design: Design, base: Structure, values: np.ndarray, prior: Prior) -> tuple[Structure, Fit]:
    """Return what remains of ``base``, and the fit of all of it."""
    full = refine(design, rows, values, base.active(design), prior=prior, passes=5, rounds=2)
    normal = full.normal.tempered(full.share)
    best, post = base, _posterior(design, normal, base, full.posterior)
    choices: tuple[tuple[dict[str, Any], ...], ...] = (
        ({"elastic": False},),
        ({"drift": False},),
        ({"ripple": False},),
        ({"friction": False},),
        ({"play": "loose", "pulley": "even"}, {"play": "constant"}, {"play": "none", "friction": False}),
        ({"cross": 2}, {"cross": 1}, {"cross": 0}),
        ({"pulley": "none"},),
        ({"scale": False},),
        ({"offset": False},),
    )
    changed = True
    while changed:
        changed = False
        for choice in choices:
            smaller = [replace(best, **change) for change in choice]
            smaller = [structure for structure in smaller if structure.active(design).sum() < post.active.sum()]
            tried = [(_posterior(design, normal, structure, post), structure) for structure in smaller]
            if not tried:
                continue
            candidate, structure = max(tried, key=lambda pair: pair[0].log_evidence)
            if candidate.log_evidence > post.log_evidence - WORTH:
                best, post, changed = structure, candidate, True
    return best, full


def _posterior(design: Design, normal: Normal, structure: Structure, start: Posterior) -> Posterior:
    return solve(design, normal, structure.active(design), start.prior, start.sigma_mm, rounds=3)


def fitted(rows: Rows, structure: Structure, ripple: tuple[int, ...], start: Choice, *, passes: int) -> Choice:
    """Fit the chosen structure with all harmonics, from the values of another fit."""
    design = structure.design(HARMONICS, ripple)
    values = design.moved(start.fit.posterior.values, start.design)
    fit = refine(
        design, rows, values, structure.active(design), prior=start.fit.posterior.prior, passes=passes, rounds=3
    )
    return Choice(structure, design, fit)
