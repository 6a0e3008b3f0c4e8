"""MacKay's fixed point of the scales of a prior and of σ (physics.md eq. 19). Checks: fit.py."""

import numpy as np

from printmend.jit import entry
from printmend_lab.greybox.drive.kernels.triangular import cholesky, invert_lower


# Its many parameters are the equations, the prior and the three arrays that it fills. Long because each round of the
# fixed point goes through prior, factor, solution and scales, on the same scratch arrays.
@entry(error_model="numpy")
def settle(
    matrix, slope, pull, about, square, count, usual, group, most, scales, sigma2, floor2, share, rounds,
    values, root, whitened,
):  # fmt: skip
    """Fill the arrays with the posterior after ``rounds`` updates; return (σ², misfit, log determinant).

    ``matrix`` [A, A] and ``slope`` [A] are the equations about 0; about ``about`` [A] their slope is ``pull`` [A] and
    the weighted square of the residuals ``square``, over ``count`` rows. Parameter i has the prior variance
    usual[i] · scales[group[i]]². The last of ``scales`` [G + 1] is 1 and stays, the others are learned, to at most
    ``most`` [G]. ``floor2`` is the least σ², ``share`` the share of σ² that the weights leave. ``values`` [A] become
    the parameters, ``root`` [A] the priors' standard deviations, ``whitened`` [A, A] the inverse of the triangular
    factor of the precision in units of the prior: the covariance is root · whitenedᵀ whitened · root.
    """
    size, groups = len(slope), len(scales) - 1
    factor, spread = np.empty((size, size)), np.empty(size)
    members, settled, moved = np.empty(groups), np.empty(groups), np.empty(groups)
    misfit = 0.0
    for turn in range(rounds + 1):
        for i in range(size):
            root[i] = np.sqrt(usual[i]) * scales[group[i]]
        for i in range(size):
            own = root[i] / sigma2
            for j in range(i, size):
                factor[i, j] = matrix[i, j] * (own * root[j])
            factor[i, i] += 1.0  # the matrix is at least the identity, so that its factor always exists
        cholesky(factor)
        whitened[:] = 0.0
        invert_lower(factor, whitened)
        values[:] = 0.0
        spread[:] = 0.0
        for i in range(size):
            row, along = whitened[i], 0.0
            for j in range(i + 1):
                along += row[j] * (root[j] * slope[j])
            for j in range(i + 1):
                values[j] += row[j] * along
                spread[j] += row[j] * row[j]
        for i in range(size):
            values[i] *= root[i] / sigma2
        misfit = square
        for i in range(size):
            row, bend = matrix[i], 0.0
            for j in range(size):
                bend += row[j] * (values[j] - about[j])
            misfit += (values[i] - about[i]) * (bend - 2.0 * pull[i])
        misfit = max(misfit, 0.0)
        if turn == rounds:
            break
        members[:] = 0.0
        settled[:] = 0.0
        moved[:] = 0.0
        known = 0.0
        for i in range(size):
            known += 1.0 - spread[i]
            if group[i] < groups:
                members[group[i]] += 1.0
                settled[group[i]] += 1.0 - spread[i]
                moved[group[i]] += (values[i] / root[i]) ** 2
        sigma2 = max(misfit / max(count - known, 1.0) / share, floor2)
        # τ² ← τ² Σ w²/v / γ; γ = Σ (1 − C_ii/v_i) counts what the data settle
        for g in range(groups):
            if members[g] > 0.0:
                ratio = min(max((moved[g] + 0.1) / (settled[g] + 0.1), 0.01), 100.0)
                scales[g] = min(max(scales[g] * np.sqrt(ratio), 1e-3), most[g])
    log_det = 0.0
    for i in range(size):
        log_det += 2.0 * np.log(factor[i, i])
    return sigma2, misfit, log_det
