"""What the parts that a fit left out may still do to a motor's branches: a share of the error bars.

A part is left out unless the evidence for it is strong, which keeps models simple but does not prove that the part is
small. So the chosen model is averaged with each model that has one part more, at their chances p under the same rows:

    variance = C + Σ p (C' − C + δ²),   p = w / (1 + Σ w),   w = exp(evidence' − evidence − price)

where the price is `WAVES_NATS` for a part of waves, and δ is the difference of the two models (Hoeting et al., Bayesian
model averaging, Stat. Sci. 14, 1999). That is its variance; the average itself is a mixture: with the chance 1 − p a
part does nothing at all.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from printmend_lab.greybox.drive.design import Design, Rows, normal_equations
from printmend_lab.greybox.drive.fit import robust_weights, solve
from printmend_lab.greybox.drive.select import EVERYTHING, TRIAL_HARMONICS, Choice, Structure

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
