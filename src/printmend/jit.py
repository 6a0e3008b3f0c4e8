"""Compiled entry points that are compiled again when anything they call has changed, and loaded without the compiler.

Numba keeps compiled code for each file and notices only changes of that one file: after an update, a kernel that calls
another file's would go on running the old code. And before it loads kept code it reads in all that it could compile,
0.2 s of every command, though the code needs nothing of it but the run-time system.
"""

import hashlib
import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numba import njit
from numba.core.event import Event, Listener, register
from numba.core.runtime import rtsys

log = logging.getLogger(__name__)


class _FirstCompilation(Listener):
    """Say why nothing happens for a while: kernels are compiled when they are first used on a machine."""

    def __init__(self) -> None:
        self.said = False

    def on_start(self, event: Event) -> None:
        if not self.said:
            self.said = True
            log.info("compiling for this machine, this one time: up to a minute")

    def on_end(self, event: Event) -> None:
        pass


register("numba:compile", _FirstCompilation())


def entry(**options: Any) -> Callable[[Callable], Callable]:
    """Decorate a kernel that Python calls: compiled, kept on disk, run beside other threads. ``options`` are njit's."""

    def decorate(function: Callable) -> Callable:
        compiled = njit(cache=True, nogil=True, **options)(function)
        cache = getattr(compiled, "_cache", None)
        if cache is not None and hasattr(cache, "_load_overload"):
            cache.load_overload = partial(_loaded, cache)
        kept = getattr(cache, "_cache_file", None)
        if kept is not None and hasattr(kept, "_source_stamp"):
            kept._source_stamp = (kept._source_stamp, _digest(function, options))
        return compiled

    return decorate


def _loaded(cache: Any, signature: Any, context: Any) -> Any:
    """Load kept code as numba's cache does, the refresh of its compiler left out (compiling does that again)."""
    rtsys.initialize(context)
    with cache._guard_against_spurious_io_errors():
        return cache._load_overload(signature, context)


def _digest(function: Callable, options: dict[str, Any]) -> str:
    """Return a digest of a function, of all compiled functions that it calls, and of the constants they use."""
    digest = hashlib.sha256(repr(sorted(options.items())).encode())
    waiting, seen = [function], {function}
    while waiting:
        code, names = waiting[0].__code__, waiting[0].__globals__
        waiting.pop(0)
        digest.update(code.co_code + repr((code.co_consts, code.co_names, code.co_varnames)).encode())
        for name in code.co_names:
            value = names.get(name)
            called = getattr(value, "py_func", None)
            if value is not None and called is not None and called not in seen:
                seen.add(called)
                waiting.append(called)
                digest.update(repr(sorted(value.targetoptions.items())).encode())
            elif isinstance(value, np.ndarray):
                digest.update(value.tobytes())
            elif isinstance(value, int | float | tuple | str | np.generic):
                digest.update(f"{name}={value!r}".encode())
    return digest.hexdigest()
