"""The causes of an expected error in an owner's words, and of which type each is (JCGM 100:2008, 4.2 and 4.3)."""

from collections.abc import Mapping

from printmend.effects import EFFECTS

# key of `Promise.made_of` → (in a line, in a table, type): type A is from the scatter of the measurement, B is not
_CAUSES = {
    "parameters": ("what the test print left open", "what the test print left open of the printer's parts", "A"),
    "unexplained": ("what follows no known fault", "what follows no known fault", "A"),
    "scatter": ("the printer's scatter", "how far marks scatter beyond what measures them", "A"),
    "screw": ("the Z screw", "how far it pushes each layer, as few heights tell it", "A"),
    "homing": ("play at home", "where in its play a belt rests at home", "B"),
    "instrument": ("the scanner", "the scanner's or photo's own scale and squareness", "B"),
    "motion": ("printing beside measuring", "how printing differs from what a test print shows", "B"),
    "rounding": ("micro-steps", "the motors' micro-steps", "B"),
    "planning": ("planning", "how closely mending follows the wanted path", "B"),
}  # fmt: skip
_LEAST_MM = 0.0005  # a smaller share is not said in a line


def in_a_table(cause: str) -> tuple[str, str]:
    """Return a cause in words, and its type; an effect that does not act is called as it calls itself."""
    if cause in _CAUSES:
        return _CAUSES[cause][1:]
    return f"what does not fit ({in_words(cause)})", "A"


def in_words(cause: str) -> str:
    """Return a cause in a few words."""
    return _CAUSES[cause][0] if cause in _CAUSES else getattr(EFFECTS.get(cause), "cause", cause.replace("_", " "))


def in_a_line(made_of: Mapping[str, float]) -> str:
    """Return what an expected error is made of, the largest first: ``the scanner 0.004, micro-steps 0.001``."""
    shares = sorted(made_of.items(), key=lambda item: -item[1])
    return ", ".join(f"{in_words(name)} {share:.3f}" for name, share in shares if share >= _LEAST_MM)
