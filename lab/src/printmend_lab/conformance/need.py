"""How a check says no, and how near is near enough."""

import numpy as np

# Imagined positions may differ by this many full steps, 0.2 µm on the presets: between one state and a batch, tables
# and `advance`, one run and the next. A network in single precision keeps it, as does one whose sums a library orders
# by the batch's size. What it costs: a plan's RMSE is off by no more than the positions it was planned by; tables of
# results show 0.001 steps, and the lattice's own rounding is 0.4.
NEAR_STEPS = 1e-3
# A printer without a fault may be made worse by so much, the RMSE of a layer [full steps]: 0.01 mm on the presets, a
# fifth of what callipers tell.
HARMLESS_STEPS = 0.05


def need(kept: object, reason: str) -> None:
    """Raise `AssertionError` with the reason unless it is kept; unlike assert, with python -O too."""
    if not kept:
        raise AssertionError(reason)


def near(found: np.ndarray, wanted: np.ndarray, what: str) -> None:
    """Raise `AssertionError` unless positions are finite and within `NEAR_STEPS` of those wanted."""
    found, wanted = np.asarray(found, float), np.asarray(wanted, float)
    need(found.shape == wanted.shape, f"{what}: expected positions {wanted.shape}, found {found.shape}")
    need(np.isfinite(found).all(), f"{what}: expected finite positions, found nan or infinity")
    most = float(np.abs(found - wanted).max(initial=0.0))
    need(most <= NEAR_STEPS, f"{what}: expected positions within {NEAR_STEPS} full steps, found {most:.2g}")
