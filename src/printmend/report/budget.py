"""The uncertainty budget of an expected error, cause by cause, after the GUM (JCGM 100:2008)."""

from printmend.promise.predict import Promise

# key of `Promise.made_of` → (what it is, type): type A is from the scatter of the measurement, B from elsewhere
_CAUSES = {
    "parameters": ("what the test print left open of the printer's parts", "A"),
    "unexplained": ("what follows no known fault", "A"),
    "homing": ("where in its play a belt rests at home", "B"),
    "instrument": ("the scanner's or photo's own scale and squareness", "B"),
    "motion": ("how printing differs from what a test print shows", "B"),
    "rounding": ("the motors' micro-steps", "B"),
    "planning": ("how closely mending follows the wanted path", "B"),
}
HEAD = ("cause", "type", "standard uncertainty [mm]")
SAID = (
    "Uncertainty budget of the mended print after the GUM (JCGM 100:2008). Type A comes from the scatter of the "
    "measurement, type B from elsewhere. The combined one is the root of the sum of their squares; twice that (k = 2) "
    "is exceeded by about one point in twenty."
)


def said(name: str) -> str:
    """Return a cause in an owner's words; what the tests of misfit found has words of its own."""
    return _CAUSES[name][0] if name in _CAUSES else f"what changes with {name.replace('_', ' ')}"


def budget_rows(promise: Promise) -> list[tuple[str, ...]]:
    """Return the table of a promise's causes, its head first, the largest next [mm]."""
    made = sorted(promise.made_of.items(), key=lambda item: -item[1])
    return [
        HEAD,
        *((said(name), _CAUSES.get(name, ("", "A"))[1], f"{share:.4f}") for name, share in made),
        ("combined", "", f"{promise.rms_mm:.4f}"),
        ("expanded, k = 2", "", f"{2 * promise.rms_mm:.4f}"),
    ]
