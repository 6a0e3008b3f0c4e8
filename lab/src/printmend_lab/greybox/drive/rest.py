"""Where in its play each belt rests when a layer starts.

The paper's known state says where the carriage is, but not which side of the play holds it. The twin starts in the
middle of the play; another machine may come to the start from one side. The first rows of a trace tell: until both
sides have been touched, the position depends on where the belt rested.
"""

from collections.abc import Sequence

import numpy as np

from printmend_lab.greybox.drive.design import Rows, contacts
from printmend_lab.greybox.drive.select import Choice

Rests = tuple[float, float]
CENTRED: Rests = (0.5, 0.5)
SHARES = np.linspace(0.0, 1.0, 41)  # places in the play that are tried
LEAST_PLAY_MM = 0.03  # in narrower play it does not matter where the belt rests
LEAST_SIGMA_MM = 0.01  # smallest standard deviation of a row: that of the model itself
MOST_SQUARE = 9.0  # most that one row may cost [σ²]: an outlier says nothing
# How much the sum of squares [σ²] must fall for a rest outside the middle: either belt at an end of its play, both at
# the same share of it, any two shares. The freer the choice, the more of them would fit by chance.
AT_ENDS_PRICE, SAME_SHARE_PRICE, ANY_SHARES_PRICE = 8.0, 12.0, 20.0


def rest_shares(rows: Sequence[Rows], choices: Sequence[Choice]) -> Rests:
    """Return where in its play each belt rests at row 0, as a share from 0 (pushed forwards at once) to 1 (back).

    The answer is the middle, 0.5, unless the trace says otherwise.
    """
    one, two = (_squares(row, choice) for row, choice in zip(rows, choices, strict=True))
    ends, middle = [0, len(SHARES) - 1], len(SHARES) // 2
    price = np.full((len(SHARES), len(SHARES)), ANY_SHARES_PRICE)
    np.fill_diagonal(price, SAME_SHARE_PRICE)
    price[np.ix_(ends, ends)] = AT_ENDS_PRICE
    price[middle, middle] = 0.0
    i, j = np.unravel_index(np.argmin(one[:, None] + two[None, :] + price), price.shape)
    return float(SHARES[i]), float(SHARES[j])


def _squares(rows: Rows, choice: Choice) -> np.ndarray:
    """Return the sum of squares [σ²] that each of `SHARES` leaves in the rows before both sides were touched."""
    design, post = choice.design, choice.fit.posterior
    mean, play = design.columns(rows.motor_mm[:1], rows.period_mm, rows.origin_mm)
    width_mm = float((play @ post.values)[0])
    if width_mm < LEAST_PLAY_MM:
        return np.zeros(len(SHARES))
    lower_mm = float(rows.motor_mm[0] + (mean @ post.values)[0]) - width_mm / 2

    def missed(share: float, first: Rows) -> tuple[np.ndarray, np.ndarray]:
        values = post.values.copy()
        values[design.parts["start"]] = lower_mm + share * width_mm - rows.start_mm
        touch = contacts(design, values, first)
        return touch.belt_mm, np.nan_to_num(touch.residual_mm)

    apart = missed(0.0, rows)[0] < missed(1.0, rows)[0] - 1e-9
    until = len(rows) if apart.all() else int(np.argmin(apart))
    begin = np.arange(len(rows)) < until
    first = rows.subset(begin, begin)
    weight = first.weight / max(post.sigma_mm, LEAST_SIGMA_MM) ** 2
    return np.array([np.minimum(weight * missed(share, first)[1] ** 2, MOST_SQUARE).sum() for share in SHARES])
