"""What click says of an option, in plain words."""


def in_plain_words(said: str) -> str:
    """Return a message of click's without its names for kinds of numbers."""
    said = said.rstrip(".")
    for kind, plain in (("float range", "number"), ("integer range", "whole number"), ("integer", "whole number")):
        said = said.replace(f"is not a valid {kind}", f"is not a {plain}")
    return said
