"""Bodies that are made here: a seed and a number give the same solid for ever, and nobody else's licence applies."""

from printmend_lab.body.generated.generated import KINDS, LICENCE, generated_name, generated_solid

__all__ = ["KINDS", "LICENCE", "generated_name", "generated_solid"]
