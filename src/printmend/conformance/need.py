"""How a check says no."""


def need(kept: object, reason: str) -> None:
    """Raise `AssertionError` with the reason unless it is kept; unlike assert, with python -O too."""
    if not kept:
        raise AssertionError(reason)
