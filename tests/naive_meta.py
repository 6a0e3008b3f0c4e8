"""The columns of `printmend_lab.meta`, written one after the other as physics.md says them."""

import numpy as np


def columns(at: float, side: float, other: float, turn: float, reach: tuple[float, float]) -> list[float]:
    """The columns of one row; lengths in mm, places from the bed's middle."""
    x, q, angle = at / 100.0, other / 100.0, 2 * np.pi * at / turn
    waves = [law(k * angle) for k in range(1, 13) for law in (np.cos, np.sin)]
    narrow, wide = (
        [
            np.exp(-0.5 * ((at - apart * k) / apart) ** 2)
            for k in range(int(np.floor(reach[0] / apart)), int(np.ceil(reach[1] / apart)) + 1)
        ]
        for apart in (10.0, 30.0)
    )
    elastic = [x * law(k * angle) for k in (1, 3, 5) for law in (np.cos, np.sin)]
    play = [1.0, *waves[:12], *wide, x, x * x]
    return [1.0, x, *waves, *narrow, *wide, *elastic, q, q * q, q * x, x * x, q**3, *(side / 2 * one for one in play)]
