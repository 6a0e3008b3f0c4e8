"""Compute once what several tests of a file ask for."""

import functools
import hashlib
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np


def remembered(function: Callable, most: int = 16) -> Callable:
    """Return a function that computes each result once: the same arguments, in content, give the same object again.

    The last ``most`` results are remembered: what was learned takes tens of megabytes. A generator among the arguments
    is left as the computation left it.
    """
    known: dict[bytes, tuple[Any, list[Any]]] = {}

    @functools.wraps(function)
    def asked(*arguments: Any, **options: Any) -> Any:
        key = hashlib.sha256(pickle.dumps((arguments, sorted(options.items())))).digest()
        generators = [each for each in (*arguments, *options.values()) if isinstance(each, np.random.Generator)]
        if key not in known:
            result = function(*arguments, **options)
            known[key] = result, [each.bit_generator.state for each in generators]
            if len(known) > most:
                del known[next(iter(known))]
        result, states = known[key]
        for generator, state in zip(generators, states, strict=True):
            generator.bit_generator.state = state
        return result

    return asked
