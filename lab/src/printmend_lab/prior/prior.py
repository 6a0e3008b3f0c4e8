"""The grey box with a learned prior over pulleys, for parts that show less than a whole turn of a motor.

Where a trace saw the whole turn this is the grey box, to the last bit. Where it did not, the grey box still finds play,
frame, noise and contacts. The shape of the whole pulley then follows from `mixture` as its prior and the grey box's own
normal equations, with all other parameters marginalised. The answer is again a mean and a covariance, and the
uncertainty grows where nothing was seen.
"""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.greybox import GreyboxModel, fit_greybox
from printmend_lab.greybox.drive.design import Design, Normal, Rows, contacts, normal_equations
from printmend_lab.greybox.drive.fit import (
    ALL_SEEN,
    GLIMPSED_TURN,
    SEED,
    Fit,
    Posterior,
    Prior,
    drawn_about,
    refine,
    robust_weights,
    seen_share,
    variances,
)
from printmend_lab.greybox.drive.select import HARMONICS, Choice
from printmend_lab.greybox.pulley import to_parameters
from printmend_lab.prior.mixture import Mixture, shape_posterior, shipped

LEAST_SIGMA_MM = 0.005  # smallest noise that is assumed: no component of the mixture is exact to less
CONTACT_ROUNDS = 2  # how often contacts and posterior are found in turn


@dataclass(frozen=True, eq=False)
class PriorLearner:
    """The learner ``prior``; with ``mixture`` None it uses the mixture that comes with printmend."""

    name: str = "prior"
    mixture: Mixture | None = None

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> GreyboxModel:
        """Learn from a trace as the grey box does. Raise `TraceError` where it does."""
        with threadpool_limits(1, user_api="blas"):
            return fit_greybox(trace, printer, rng, complete=self._complete)

    def _complete(self, rows: Rows, choice: Choice) -> Choice:
        if not GLIMPSED_TURN < seen_share(rows, choice.fit.touch) < ALL_SEEN or not _applies(choice):
            return choice
        return with_learned_pulley(rows, choice, self.mixture or shipped())


def _applies(choice: Choice) -> bool:
    """Say whether the mixture knows drives of this kind: the pulley bends both branches alike, everywhere."""
    structure = choice.structure
    plain = structure.play in ("none", "constant") and not (structure.elastic or structure.drift or structure.warp_mm)
    return plain and (structure.scale or structure.pulley != "none")


def with_learned_pulley(rows: Rows, choice: Choice, mixture: Mixture) -> Choice:
    """Return the choice with its pulley's shape replaced by the posterior under the mixture, given the rows."""
    structure = replace(choice.structure, pulley="all", scale=True, offset=True)
    design = structure.design(HARMONICS, choice.design.ripple, rows.reach_mm)
    active = structure.active(design)
    start = design.moved(choice.fit.posterior.values, choice.design)
    fit = refine(design, rows, start, active, prior=Prior(floor_mm=LEAST_SIGMA_MM), passes=3, rounds=4)
    sigma = max(fit.posterior.sigma_mm, LEAST_SIGMA_MM)
    normal, touch, share = fit.normal, fit.touch, fit.share
    for round_ in range(CONTACT_ROUNDS):
        post, machines = _posterior(design, normal.tempered(share), sigma, rows.period_mm, mixture)
        touch = contacts(design, post.values, rows)
        if round_ < CONTACT_ROUNDS - 1:
            weight = robust_weights(rows, touch.residual_mm, sigma, drop=True)
            normal = normal_equations(design, post.values, rows, touch, weight)
    loss = float(np.abs(touch.residual_mm[rows.weight > 0]).mean())
    return Choice(structure, design, Fit(post, normal, touch, loss, share), machines)


def _posterior(
    design: Design, normal: Normal, sigma_mm: float, period_mm: float, mixture: Mixture
) -> tuple[Posterior, np.ndarray]:
    """Return the posterior of all parameters, with the mixture as the prior of those of the pulley's shape, and how far
    from its mean machines lie that are possible [P, R]."""
    shape = np.zeros(design.size, bool)
    shape[design.scale_at] = True
    shape |= design.mask("mean")
    rest = ~shape
    unit = to_parameters(design, period_mm)[shape]  # [1 + 2K, D]: parameters = unit @ θ
    matrix = normal.matrix / sigma_mm**2
    slope = (normal.slope + normal.matrix @ normal.values) / sigma_mm**2
    # Given the shape, the rest is linear with wide Gaussian priors, and can be marginalised in closed form.
    inner = matrix[np.ix_(rest, rest)] + np.diag(1 / variances(design, Prior())[rest])
    inverse = np.linalg.inv(inner)
    tie = matrix[np.ix_(rest, shape)]
    narrowed = matrix[np.ix_(shape, shape)] - tie.T @ inverse @ tie
    pull = slope[shape] - tie.T @ inverse @ slope[rest]
    found = shape_posterior(mixture, unit.T @ narrowed @ unit, unit.T @ pull)
    values, covariance = np.zeros(design.size), np.zeros((design.size, design.size))
    values[shape] = unit @ found.mean
    values[rest] = inverse @ (slope[rest] - tie @ values[shape])
    wide = unit @ found.covariance @ unit.T
    along = -inverse @ tie
    covariance[np.ix_(shape, shape)] = wide
    covariance[np.ix_(rest, shape)] = along @ wide
    covariance[np.ix_(shape, rest)] = (along @ wide).T
    covariance[np.ix_(rest, rest)] = inverse + along @ wide @ along.T
    everything = np.ones(design.size, bool)
    machines = np.zeros((design.size, found.drawn.shape[1]))
    machines[shape] = unit @ (found.drawn - found.mean[:, None])
    scatter = drawn_about(inverse, machines.shape[1], np.random.default_rng(SEED))
    machines[rest] = along @ machines[shape] + scatter
    post = Posterior(values, covariance, everything, sigma_mm, Prior(floor_mm=LEAST_SIGMA_MM), found.log_evidence)
    return post, machines


LEARNERS = {"prior": PriorLearner()}
