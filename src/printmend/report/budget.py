"""The uncertainty budget of an expected error, cause by cause, after the GUM (JCGM 100:2008)."""

from printmend.promise.predict import Promise
from printmend.promise.words import in_a_table

HEAD = ("cause", "type", "standard uncertainty [mm]")
SAID = (
    "Uncertainty budget of the expected print after the GUM (JCGM 100:2008). Type A comes from the scatter of the "
    "measurement, type B from elsewhere. The combined one is the root of the sum of their squares; twice that (k = 2) "
    "is exceeded by about one point in twenty of a usual print. Few prints ring, stick or have a loose nozzle, which "
    "dots printed at rest do not show: the range of nine prints in ten holds these, too, and its upper end is theirs."
)


def budget_rows(promise: Promise) -> list[tuple[str, ...]]:
    """Return the table of a promise's causes, its head first, the largest next [mm]."""
    made = sorted(promise.made_of.items(), key=lambda item: -item[1])
    return [
        HEAD,
        *((*in_a_table(name), f"{share:.4f}") for name, share in made),
        ("combined", "", f"{promise.rms_mm:.4f}"),
        ("expanded, k = 2", "", f"{2 * promise.rms_mm:.4f}"),
        ("combined, of nine prints in ten", "", f"{promise.rms_low_mm:.4f}–{promise.rms_high_mm:.4f}"),
    ]
