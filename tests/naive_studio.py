"""The slow, obvious twin of the studio's kernel."""

import numpy as np
import shapely


def distances(wanted: np.ndarray, printed: np.ndarray, joined: np.ndarray, near: int) -> np.ndarray:
    """Return the distance of each printed point from the wanted bead around it, ``near`` + 1 segments either way."""
    out = np.zeros(len(wanted))
    for i, place in enumerate(printed):
        before, after = [wanted[i]], [wanted[i]]
        for j in range(i - 1, max(i - near - 2, -1), -1):
            if not joined[j]:
                break
            before.insert(0, wanted[j])
        for j in range(i, min(i + near + 1, len(wanted) - 1)):
            if not joined[j]:
                break
            after.append(wanted[j + 1])
        bead = before + after[1:]
        if len(bead) > 1:
            out[i] = shapely.LineString(bead).distance(shapely.Point(place))
    return out
