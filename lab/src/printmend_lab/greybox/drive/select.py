"""Choose the simplest drive that a motor's rows support, from the nested list of physics.md eq. 20.

Every part must pay for itself in Laplace evidence, else it is switched off.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.path import last_way
from printmend_lab.greybox.drive.design import Design, Normal, Rows, normal_equations
from printmend_lab.greybox.drive.fit import Fit, Posterior, Prior, crosses, refine, robust_weights, solve, variances
from printmend_lab.greybox.layout import CROSS

COARSE_HARMONICS = 8  # of the search for contacts
TRIAL_HARMONICS = 16  # of the choice of parts
HARMONICS = 32  # of the last fit: corners of a pulley need them
PART_NATS = 6.0  # log evidence that a part must bring (odds of 400 to 1)
PLAY_NATS = 10.0  # play must bring more: it also adapts the contacts to the noise, which the evidence does not count
SURE_PLAY_SIGMAS = 3.0  # play larger than so many standard deviations of one point is no adaptation to noise
STARTS_PLAY_MM = (0.3, 3.0)  # first guesses of the play
PLAYS = ("none", "constant", "loose", "free")  # from simple to general
LEAST_ROWS_EITHER_WAY = 5  # measured rows that a motor must have gone either way, or its play cannot show
SECOND_HARMONICS = (1, 2)  # of an idler: off its centre, oval
ELASTIC_HARMONICS = (1, 3, 5)  # odd harmonics that fade along a stretching belt (physics.md eq. 8)
WARPS_MM = (10.0, 20.0, 40.0)  # lengths of the part that repeats nothing
WARP_MARGIN_MM = 20.0  # how far beyond the rows its cosines span, so that they are not mirrored within
SETTLING_PASSES = 12  # passes, or rounds of the prior, after which a fit no longer changes
FOLD_LEAST_SIGMA_MM = 0.02  # smallest noise when symmetries are compared: real ones are no better
LEAST_TURNS_TWICE = 1.6  # turns that a reach must have, or too little was seen twice to tell what repeats
AS_GOOD_SHARE, AS_GOOD_MM = 1.02, 0.002  # a simpler drive may have this much more mean residual
# Smallest noise when parts are chosen: what explains less than a micro-step imitates the corners between the harmonics.
SELECT_LEAST_SIGMA_MM = 0.003
FOLDS = (0, 1, 2, 3, 4, 5, 6, 7, 8)  # symmetries of a pulley; 0 is none, 1 an eccentric round one
LOOKS_WRONG_MM = 0.02  # a mean residual above this, with a pattern, is more than the corners of a pulley
PATTERN_SHARE = 0.8  # with a smaller share of independent rows the model lacks something smooth


@dataclass(frozen=True)
class Structure:
    """Which parts a drive has.

    ``cross`` is the highest order of the frame's terms. ``pulley`` names the harmonics of the mean (none, even or all)
    and ``play`` those of the play (none; constant; loose, with odd harmonics; free, with all). ``drift`` lets the mean
    bend along the axis, ``friction`` the play. ``warp_mm`` is the length of the part that repeats nothing,
    ``second_mm`` the length with which an idler repeats, 0 for none.
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
    warp_mm: float = 0.0
    second_mm: float = 0.0

    @property
    def is_healthy(self) -> bool:
        return self == NOTHING

    @property
    def waves(self) -> bool:
        """Say whether the mean has parts that average to 0 over a turn or the axis: they need an offset, too."""
        return self.pulley != "none" or self.ripple or self.elastic or self.warp_mm > 0 or self.second_mm > 0

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
        on |= design.mask("second") & (0 < self.second_mm == design.second_mm)
        warp = np.arange(design.warp) < self._cosines(design.warp_span_mm)
        on[parts["warp"]] = warp
        return on

    def _cosines(self, span_mm: tuple[float, float]) -> int:
        """Return how many cosines over a span make a Gaussian process of length ``warp_mm``, to 3e-4 of its size."""
        return math.ceil(4.0 * (span_mm[1] - span_mm[0]) / (np.pi * self.warp_mm)) if self.warp_mm else 0

    def design(self, harmonics: int, ripple: tuple[int, ...], reach_mm: tuple[float, float] = (0.0, 1.0)) -> Design:
        """Return the columns of these parts, with that many harmonics, for motor positions within ``reach_mm``."""
        span_mm = (reach_mm[0] - WARP_MARGIN_MM, reach_mm[1] + WARP_MARGIN_MM)
        waves = tuple(range(1, harmonics + 1))
        even, odd = waves[1::2], waves[::2]
        return Design(
            mean_powers=4 if self.drift else 2 if self.scale else int(self.offset),
            play_powers=0 if self.play == "none" else 3 if self.friction else 1,
            cross=tuple((p, q) for p, q in CROSS if p + q <= self.cross),
            ripple=ripple if self.ripple else (),
            mean_harmonics={"none": (), "even": even, "all": waves}[self.pulley],
            play_harmonics={"none": (), "constant": (), "loose": odd, "free": waves}[self.play],
            elastic_harmonics=ELASTIC_HARMONICS if self.elastic else (),
            warp=self._cosines(span_mm),
            warp_span_mm=span_mm if self.warp_mm or self.second_mm else (0.0, 1.0),
            second_harmonics=SECOND_HARMONICS if self.second_mm else (),
            second_mm=self.second_mm,
        )


NOTHING = Structure(offset=False, scale=False, cross=0, pulley="none", play="none")
EVERYTHING = Structure(drift=True, cross=3, ripple=True, play="free", friction=True, elastic=True)


@dataclass(frozen=True, eq=False)
class Choice:
    """A structure, its columns and its fit.

    Where a pulley was seen in part, ``machines`` [P, R] are R that the rest may make of it, each as likely: how far
    their parameters lie from the fit's. None where the fit's covariance says all.
    """

    structure: Structure
    design: Design
    fit: Fit
    machines: np.ndarray | None = None


def supported(rows: Rows, structure: Structure) -> Structure:
    """Return the structure without what these rows cannot tell from other parts.

    This is the play of a motor that was measured going one way only, and the frame where the axes only moved together.
    """
    went = last_way(rows.motor_mm)[rows.weight > 0]
    if min((went > 0).sum(), (went < 0).sum()) < LEAST_ROWS_EITHER_WAY:
        structure = replace(structure, play="none", friction=False)
    return structure if crosses(rows) else replace(structure, cross=0)


def main_parts(rows: Rows) -> Choice:
    """Find the contacts, with few harmonics and from several first guesses; return the best of the main structures."""
    plain = supported(rows, Structure(play="free"))
    best = _searched(rows, plain)
    if best.fit.share > PATTERN_SHARE / 2 * rows.independent or best.fit.loss_mm < LOOKS_WRONG_MM:
        return best
    warped = _searched(rows, replace(plain, warp_mm=WARPS_MM[1]))
    return warped if warped.fit.loss_mm < 0.7 * best.fit.loss_mm else best


def _searched(rows: Rows, base: Structure) -> Choice:
    design = base.design(COARSE_HARMONICS, (), rows.reach_mm)
    place = design.parts["play_powers"]

    def tried(play: str, pulley: str, start_mm: float) -> Choice:
        structure, values = replace(base, pulley=pulley, play=play), np.zeros(design.size)
        values[place] = start_mm
        active = structure.active(design)
        prior = _prior(Prior(), structure)
        fit = refine(design, rows, values, active, prior=prior, passes=12, rounds=1, patience=2, drop=False)
        return Choice(structure, design, fit)

    if base.play == "none":
        return tried("none", "all", 0.0)
    played = min(
        (tried("constant", "all", start_mm) for start_mm in STARTS_PLAY_MM), key=lambda choice: choice.fit.loss_mm
    )
    play_mm = float(played.fit.posterior.values[place][0])
    best = tried("none", "all", 0.0)
    for choice in (played, tried("loose", "even", play_mm), tried("free", "all", play_mm)):
        if choice.fit.loss_mm < best.fit.loss_mm * (0.98 if choice.structure.play == "free" else 0.999):
            best = choice
    return best


def refined(rows: Rows, found: Choice) -> Choice:
    """Fit the same parts again, from the values that they have, to rows that hardly differ from those of the fit."""
    post = found.fit.posterior
    active = found.structure.active(found.design)
    fit = refine(found.design, rows, post.values, active, prior=post.prior, passes=3, rounds=1, drop=False)
    return Choice(found.structure, found.design, fit)


def coarsely_fitted(rows: Rows, structure: Structure, start: Choice) -> Choice:
    """Fit a structure with few harmonics, from the values of a fit that need not know the turn's length."""
    design = structure.design(COARSE_HARMONICS, (), rows.reach_mm)
    values = design.moved(start.fit.posterior.values, start.design)
    prior = _prior(Prior(), structure)
    fit = refine(design, rows, values, structure.active(design), prior=prior, passes=3, rounds=1, drop=False)
    return Choice(structure, design, fit)


def prune(rows: Rows, found: Choice, ripple: tuple[int, ...], *, scaled: bool = False) -> Structure:
    """Fit all parts at once, then drop one by one those that do not pay; return what remains.

    The part that repeats nothing can imitate all others where a trace is short. So it is offered only where the
    residuals have a pattern, or in place of parts that grow along the axis, which may imitate it under noise. With
    ``scaled``, for an instrument that knows no scale, a scale stays beside it: else that of the instrument, which acts
    on no print, would pass for an error that repeats nothing.
    """
    most = supported(rows, EVERYTHING)
    structure, share = _chosen(rows, found, ripple, most, scaled=scaled)
    if share < PATTERN_SHARE * rows.independent or structure.drift or structure.elastic:
        warped = _chosen(rows, found, ripple, replace(most, warp_mm=WARPS_MM[0]), scaled=scaled)[0]
        if warped.warp_mm:
            structure = _likelier(rows, found, ripple, structure, warped)
    return _repeating(rows, found, ripple, structure)


def _likelier(rows: Rows, found: Choice, ripple: tuple[int, ...], plain: Structure, warped: Structure) -> Structure:
    """Return the likelier of two structures, each fitted until its own contacts and outliers are settled.

    The contacts of the fit from which both were pruned may be those of a machine that only the larger one can follow.
    """
    ours, theirs = (fitted(rows, structure, ripple, found, passes=SETTLING_PASSES) for structure in (plain, warped))
    return warped if likelier(theirs, ours) > PART_NATS else plain


def _repeating(rows: Rows, found: Choice, ripple: tuple[int, ...], structure: Structure) -> Structure:
    """Prefer parts that repeat every turn, where little more than a turn was seen and they explain as much.

    Nothing tells them from parts that grow or bend along the axis then, but only they say how the drive goes on.
    """
    simple = replace(
        structure, warp_mm=0.0, drift=False, elastic=False, offset=True, scale=True,
        pulley="all" if structure.pulley == "none" or structure.warp_mm else structure.pulley,
    )  # fmt: skip
    low_mm, high_mm = rows.reach_mm
    grows = structure.warp_mm or structure.drift or structure.elastic
    if not grows or high_mm - low_mm > LEAST_TURNS_TWICE * rows.period_mm:
        return structure
    losses = [fitted(rows, each, ripple, found, passes=4).fit.loss_mm for each in (structure, simple)]
    return simple if losses[1] <= AS_GOOD_SHARE * losses[0] + AS_GOOD_MM else structure


def _chosen(
    rows: Rows, found: Choice, ripple: tuple[int, ...], base: Structure, *, scaled: bool
) -> tuple[Structure, float]:
    """Return what remains of ``base``, and the share of independent residuals of the fit with all of ``base``.

    Contacts adapt to the play that a model has: at the contacts of a machine with play a taut one looks worse than it
    is. So a taut machine is fitted with contacts of its own before play is preferred to it.
    """
    base = replace(base, ripple=base.ripple and bool(ripple))  # where no ripple can be seen there is none to drop
    design = base.design(TRIAL_HARMONICS, ripple, rows.reach_mm)
    values = design.moved(found.fit.posterior.values, found.design)
    prior = replace(found.fit.posterior.prior, floor_mm=SELECT_LEAST_SIGMA_MM)
    played, full = _pruned(rows, design, base, values, prior, scaled=scaled)
    play_mm = full.posterior.values[design.parts["play_powers"]]
    if played.play == "none" or play_mm[0] > SURE_PLAY_SIGMAS * full.posterior.sigma_mm:
        return played, full.share
    without = replace(base, play="none", friction=False)
    values = full.posterior.values * without.active(design)
    prior = replace(full.posterior.prior, floor_mm=SELECT_LEAST_SIGMA_MM)
    taut, loser = _pruned(rows, design, without, values, prior, scaled=scaled)
    ours, theirs = (
        _evidence(rows, design, structure, fit, full.share) for structure, fit in ((played, full), (taut, loser))
    )
    return played if ours > theirs + PLAY_NATS else taut, full.share


def _evidence(rows: Rows, design: Design, structure: Structure, start: Fit, share: float) -> float:
    """Return the log evidence of a structure, fitted with contacts of its own."""
    active, post = structure.active(design), start.posterior
    fit = refine(design, rows, post.values * active, active, prior=_prior(post.prior, structure), passes=3, rounds=2)
    return _posterior(design, fit.normal.tempered(share), structure, fit.posterior).log_evidence


def _pruned(
    rows: Rows, design: Design, base: Structure, values: np.ndarray, prior: Prior, *, scaled: bool
) -> tuple[Structure, Fit]:
    """Return what remains of ``base`` when parts that do not pay are dropped, and the fit of all of it."""
    full = refine(design, rows, values, base.active(design), prior=_prior(prior, base), passes=5, rounds=2)
    normal = full.normal.tempered(full.share)
    best, post = base, _posterior(design, normal, base, full.posterior)
    choices: tuple[tuple[dict[str, Any], ...], ...] = (
        tuple({"warp_mm": length} for length in (0.0, *WARPS_MM[1:])),
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
            smaller = [structure for structure in smaller if structure.offset or not structure.waves]
            smaller = [structure for structure in smaller if structure.scale or not (scaled and structure.warp_mm)]
            smaller = [structure for structure in smaller if PLAYS.index(structure.play) <= PLAYS.index(best.play)]
            tried = [(_posterior(design, normal, structure, post), structure) for structure in smaller]
            if not tried:
                continue
            candidate, structure = max(tried, key=lambda pair: pair[0].log_evidence)
            if candidate.log_evidence > post.log_evidence - PART_NATS:
                best, post, changed = structure, candidate, True
    return best, full


def _posterior(design: Design, normal: Normal, structure: Structure, start: Posterior) -> Posterior:
    prior = _prior(start.prior, structure)
    return solve(design, normal, structure.active(design), prior, start.sigma_mm, rounds=3)


def _prior(prior: Prior, structure: Structure) -> Prior:
    return replace(prior, warp_mm=structure.warp_mm) if structure.warp_mm else prior


def folded(rows: Rows, choice: Choice, ripple: tuple[int, ...]) -> Choice:
    """Fit a pulley that was seen in part as a symmetric one, where the evidence says so: then its rest is known.

    Half a turn shows all of an oval, a third of a turn all of a triangle. The symmetries are compared with the prior
    without any, on the same simple parts, which a short trace cannot tell from stranger ones. No pulley is symmetric to
    the micrometre, so its deviations count as noise; else they would speak against a symmetry that they hardly disturb.
    """
    simple = replace(choice.structure, pulley="all", drift=False, elastic=False, warp_mm=0.0, offset=True, scale=True)
    if simple.play in ("loose", "free"):
        simple = replace(simple, play="constant")
    found: list[Choice] = []
    taut = replace(simple, play="none", friction=False)
    offered = {choice.structure: FOLDS[:1], simple: FOLDS, taut: FOLDS}
    for structure, folds in offered.items():
        design = structure.design(HARMONICS, ripple, rows.reach_mm)
        start = design.moved(choice.fit.posterior.values, choice.design)
        for fold in folds:
            prior = Prior(fold=fold, floor_mm=FOLD_LEAST_SIGMA_MM)
            on = ~design.mask("mean") | (variances(design, prior) >= variances(design, Prior()) * 0.99)
            fit = refine(design, rows, start * on, structure.active(design), prior=prior, passes=5, rounds=6)
            found.append(Choice(structure, design, fit))
    share = max(each.fit.share for each in found)
    return max(
        found,
        key=lambda each: (
            _settled(each, share, FOLD_LEAST_SIGMA_MM) - (0.0 if each.structure in (simple, taut) else PART_NATS)
        ),
    )


def _settled(choice: Choice, share: float, floor_mm: float) -> float:
    """Return the log evidence of a fit at its own contacts, after the prior's scales have settled."""
    fit = choice.fit
    active, post = choice.structure.active(choice.design), fit.posterior
    prior = replace(post.prior, floor_mm=floor_mm)
    return solve(
        choice.design, fit.normal.tempered(share), active, prior, post.sigma_mm, rounds=SETTLING_PASSES
    ).log_evidence


def likelier(one: Choice, other: Choice) -> float:
    """Return by how many nats one fit of the same rows is likelier than another, each at its own contacts."""
    share = max(one.fit.share, other.fit.share)
    ours, theirs = (_settled(each, share, SELECT_LEAST_SIGMA_MM) for each in (one, other))
    return ours - theirs


def fitted(rows: Rows, structure: Structure, ripple: tuple[int, ...], start: Choice, *, passes: int) -> Choice:
    """Fit a structure with all harmonics, from the values of another fit."""
    design = structure.design(HARMONICS, ripple, rows.reach_mm)
    values = design.moved(start.fit.posterior.values, start.design)
    prior = _prior(start.fit.posterior.prior, structure)
    fit = refine(design, rows, values, structure.active(design), prior=prior, passes=passes, rounds=3)
    return Choice(structure, design, fit)


# What the parts that a fit left out may still do to a motor's branches: a share of the error bars.
#
# A part is left out unless the evidence for it is strong, which keeps models simple but does not prove that the part is
# small. So the chosen model is averaged with each model that has one part more, at their chances p under the same rows:
#
# variance = C + Σ p (C' − C + δ²), p = w / (1 + Σ w), w = exp(evidence' − evidence − price)
#
# where the price is `WAVES_NATS` for a part of waves, and δ is the difference of the two models (Hoeting et al.,
# Bayesian model averaging, Stat. Sci. 14, 1999). That is its variance; the average itself is a mixture: with the chance
# 1 − p a part does nothing at all.

WAVES_NATS = 1.5  # by which a model with more waves is flattered: the scales of their priors are fitted to the rows


@dataclass(frozen=True, eq=False)
class OmittedParts:
    """What the parts that were left out add to the uncertainty of a motor's branches.

    Each of ``parts`` is the chance p of one that is there after all, and the covariance [P, P] mm² over the parameters
    of ``design`` that it has then; it comes on top of that of the chosen parts.
    """

    design: Design
    parts: tuple[tuple[float, np.ndarray], ...]

    @property
    def covariance(self) -> np.ndarray:
        """The covariance [P, P] of all of them together, none of them known to be there."""
        return np.asarray(sum((chance * each for chance, each in self.parts), np.zeros((self.design.size,) * 2)))

    def variances(self, columns: np.ndarray) -> np.ndarray:
        """Return the variances [N] mm² that parameters with this covariance give to places with columns [N, P]."""
        return np.maximum(np.einsum("ij,jk,ik->i", columns, self.covariance, columns, optimize=True), 0.0)


def left_out(rows: Rows, choice: Choice, ripple: tuple[int, ...]) -> OmittedParts:
    """Return what the parts that ``choice`` left out may do to the branches, given the rows that it was fitted to."""
    mine, fit = choice.structure, choice.fit
    most = replace(EVERYTHING, cross=mine.cross, ripple=mine.ripple, warp_mm=mine.warp_mm, second_mm=mine.second_mm)
    design = most.design(TRIAL_HARMONICS, ripple, rows.reach_mm)
    post = fit.posterior
    weight = robust_weights(rows, fit.touch.residual_mm, post.sigma_mm, drop=True)
    values = design.moved(fit.normal.values, choice.design)
    normal = normal_equations(design, values, rows, fit.touch, weight).tempered(fit.share)
    own = mine.active(design)
    chosen = solve(design, normal, own, post.prior, post.sigma_mm, rounds=2)
    parts = []
    for structure in _larger(mine):
        more = structure.active(design) | own
        if more.sum() == own.sum():
            continue
        larger = solve(design, normal, more, post.prior, post.sigma_mm, rounds=2)
        shift = (larger.values - chosen.values)[more]
        added = larger.covariance + np.outer(shift, shift)
        inside = own[more]
        added[np.ix_(inside, inside)] -= chosen.covariance
        covariance = np.zeros((design.size, design.size))
        covariance[np.ix_(more, more)] = added
        price = WAVES_NATS if design.harmonic[more & ~own].any() else 0.0
        parts.append((larger.log_evidence - chosen.log_evidence - price, covariance))
    whole = np.logaddexp.reduce([0.0, *(gain for gain, _ in parts)])
    return OmittedParts(design, tuple((float(np.exp(gain - whole)), covariance) for gain, covariance in parts))


def _larger(mine: Structure) -> Iterator[Structure]:
    """Return every structure with one part more, of the parts that can move a branch by much."""
    played = "constant" if mine.play == "none" else mine.play
    yield replace(mine, offset=True)
    yield replace(mine, scale=True)
    yield replace(mine, pulley="all")
    yield replace(mine, drift=True)
    yield replace(mine, elastic=True)
    yield replace(mine, play=played)
    yield replace(mine, play=played, friction=True)
    yield replace(mine, play="loose")
    yield replace(mine, play="free")
