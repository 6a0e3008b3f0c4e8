"""The slow, obvious twins of the studio's kernels."""

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


def points(
    start: np.ndarray, end: np.ndarray, center: np.ndarray, turn: np.ndarray, sweep: np.ndarray, counts: np.ndarray,
    jumped: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return points along lines and arcs: an arc's are its first point, turned about the centre by complex numbers."""
    out = []
    for line, count in enumerate(counts):
        if jumped[line]:
            out.append(start[line])
        for step in range(1, count + 1):
            place = start[line] + step / count * (end[line] - start[line])
            if turn[line] and step < count:
                middle = complex(*center[line])
                turned = middle + (complex(*start[line, :2]) - middle) * np.exp(1j * sweep[line] * step / count)
                place = np.array([turned.real, turned.imag, place[2]])
            out.append(place)
    return np.array(out)
