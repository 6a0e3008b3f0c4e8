"""Layers for tests: those that the conformance suite looks at."""

from printmend_lab.conformance.need import layer_along, ring_layer

__all__ = ["layer_along", "ring_layer"]
