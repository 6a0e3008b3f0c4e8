"""Where in its play each belt rests when a layer starts.

The paper's known state says where the carriage is, not which side of the play holds it. The twin centres the play;
another machine may come to the start from one side. The first rows of a trace tell: until both sides have been
touched, the carriage is where it rested.
"""

from collections.abc import Sequence

import numpy as np

from printmend.learn.drive.design import Rows, contacts
from printmend.learn.drive.select import Choice

Rests = tuple[float, float]
CENTRED: Rests = (0.5, 0.5)
SHARES = np.linspace(0.0, 1.0, 41)
LEAST_MM = 0.03  # play narrower than this rests anywhere
LEAST_SIGMA_MM = 0.01  # the model's own errors
LOST = 9.0  # squares beyond so many σ² tell nothing
# What the squares [σ²] must fall by for rests not in the middle: each motor at an end, both at the same share, any.
AT_ENDS, ALIKE, ANY = 8.0, 12.0, 20.0


def rest_shares(rows: Sequence[Rows], choices: Sequence[Choice]) -> Rests:
    """Return where in its play each belt rests at row 0: 0 where the motor would push it forwards, 1 back.

    They rest in the middle unless the trace says otherwise.
    """
    one, two = (_squares(row, choice) for row, choice in zip(rows, choices, strict=True))
    ends, middle = [0, len(SHARES) - 1], len(SHARES) // 2
    price = np.full((len(SHARES), len(SHARES)), ANY)
    np.fill_diagonal(price, ALIKE)
    price[np.ix_(ends, ends)] = AT_ENDS
    price[middle, middle] = 0.0
    i, j = np.unravel_index(np.argmin(one[:, None] + two[None, :] + price), price.shape)
    return float(SHARES[i]), float(SHARES[j])


def _squares(rows: Rows, choice: Choice) -> np.ndarray:
    """Return the sum of squares [σ²] that each share leaves in the rows before both sides were touched."""
    design, post = choice.design, choice.fit.posterior
    mean, play = design.columns(rows.motor_mm[:1], rows.period_mm, rows.origin_mm)
    width_mm = float((play @ post.values)[0])
    if width_mm < LEAST_MM:
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
    return np.array([np.minimum(weight * missed(share, first)[1] ** 2, LOST).sum() for share in SHARES])
