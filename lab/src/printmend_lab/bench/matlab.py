"""Signals of a MATLAB file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from printmend.errors import TraceError, reason

TODO = "fetch it again, or leave it out"


def signals(path: Path, names: Sequence[str] | None = None) -> list[np.ndarray]:
    """Return signals of numbers [N] by their names; without names the only one there is. NaN may be among them.

    Raise `TraceError` for a file that does not hold them.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = {name: value for name, value in loadmat(path, variable_names=names).items() if name[:2] != "__"}
    except (OSError, ValueError, NotImplementedError, TypeError, MatReadError) as error:
        raise TraceError(path, wanted="a MATLAB file before version 7.3", came=reason(error), todo=TODO) from None
    if names is None and len(found) != 1:
        raise TraceError(path, wanted="one signal", came=f"{len(found)}", todo=TODO)
    if missing := [name for name in names or () if name not in found]:
        raise TraceError(path, wanted=f"a variable {missing[0]}", came="none of that name", todo=TODO)
    every = [np.asarray(found[name]).reshape(-1) for name in names or found]
    if any(signal.dtype.kind not in "fiu" for signal in every):
        raise TraceError(path, wanted="numbers", came="something else", todo=TODO)
    return every
