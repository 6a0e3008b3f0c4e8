"""Slow, obvious version of where the motors turn back on a path, and of the stretch on which their slack is crossed."""

import numpy as np

EPS_MM, LEAST_MM, GENTLE_CROSSING, UNCUT_CROSSING = 0.005, 0.08, 0.2, 0.75
FASTEST_ON_CURVE, FASTEST_AT_CORNER, CORNER_SLOPE, LEAST_FALL, ASLANT, SIDEWAYS_MM = 8.0, 16.0, 0.5, 4.0, 1.5, 0.01
UPRIGHT, AGREED_MM, SHORTEST_MM, STRAIGHT_BACK, WAIT = 0.8, 0.03, 0.02, 0.96, 0.3
PITCH_MM, NEAR_MM = 2e-4, 0.005


def turns(
    s_mm: np.ndarray, belt_mm: np.ndarray, other_mm: np.ndarray, slack_mm: float
) -> list[tuple[float, float, int, float, float]]:
    """Return (begin, end, trend after, corner, peak) of each reversal of more than 10 µm of a belt along nodes [N].

    ``other_mm`` [N] is the other motor's belt. ``corner`` is where the path has one, infinity where it has none.
    """
    found, floor = [], 0.0
    at, trend = 0, 0
    for i in range(1, len(belt_mm)):
        if trend == 0 and abs(belt_mm[i] - belt_mm[0]) > 2 * EPS_MM:
            at, trend = i, int(np.sign(belt_mm[i] - belt_mm[0]))
        elif trend and trend * belt_mm[i] >= trend * belt_mm[at]:
            at = i
        elif trend and trend * (belt_mm[at] - belt_mm[i]) > 2 * EPS_MM:
            way = s_mm[: i + 1], belt_mm[: i + 1], at, trend
            begin, end = stretch(*way, EPS_MM, floor)
            if slack_mm > GENTLE_CROSSING * (end - begin):
                begin, end = stretch(*way, 2 * EPS_MM, floor)
            inside = s_mm[(s_mm >= begin) & (s_mm <= end)]
            first, last = (inside.min(), inside.max()) if inside.size else (end, begin)
            choices = [(first, last), *sorted([(first, end), (begin, last)], key=lambda c: c[0] - c[1])]
            uncut = [c for c in choices if c[1] > c[0] and slack_mm <= UNCUT_CROSSING * (c[1] - c[0])]
            side = corner_side(*way, other_mm[: i + 1], floor)
            falls = [abs((belt_mm[at] - belt_mm[b]) / (s_mm[at] - s_mm[b])) for b in (at - 1, at + 1)]
            steep = slack_mm > UNCUT_CROSSING * (end - begin)
            corner = np.inf
            if steep and (
                min(falls) >= CORNER_SLOPE or max(falls) >= UPRIGHT or slack_mm > FASTEST_ON_CURVE * (end - begin)
            ):
                begin, end = side
                corner = s_mm[at]
                if slack_mm > FASTEST_AT_CORNER * (end - begin) or end - begin + slack_mm < LEAST_MM:
                    begin = end = s_mm[at]
                rounded = around(*way, other_mm[: i + 1], slack_mm, floor)
                begin, end = rounded if rounded else (begin, end)
            elif not (end - begin >= 0.02 and end - begin + slack_mm >= LEAST_MM):
                begin = end = corner = s_mm[at]
            elif uncut:
                begin, end = uncut[0]
            found.append((begin, end, -trend, corner, s_mm[at]))
            floor, at, trend = end, i, -trend
    return found


def agreed(
    mine: int, both: list[list[tuple]], s_mm: np.ndarray, belts_mm: np.ndarray, slack_mm: tuple[float, float]
) -> list[tuple]:
    """Return the turns of one motor, of those of both; where both cross at one corner they do it one after the other,
    or together on its first bit.

    Where the whole path goes back at the corner, and the larger slack is too large for that, the nozzle stands.
    """
    slope = np.abs(np.diff(belts_mm, axis=0) / np.diff(s_mm)[:, None]).min(axis=1)  # [N - 1], of the flatter belt
    found, most = [], max(slack_mm)
    for i, turn in enumerate(both[mine]):
        begin, end, trend, corner, peak = turn
        other = next((other for other in both[1 - mine] if other[4] == peak), None)
        found.append(turn)
        at = int(np.searchsorted(s_mm, peak))
        if other is None or at == 0:
            continue
        back = corner == other[3] == peak and min(slope[at - 1], slope[at]) >= CORNER_SLOPE
        if not back and min(end, other[1]) - max(begin, other[0]) <= NEAR_MM:
            continue
        slow = [k for k, (a, b) in enumerate([(turn, other), (other, turn)]) if a[3] == np.inf > b[3]]
        if not back and 0 in slow and slack_mm[mine] <= UNCUT_CROSSING * (end - other[1]):
            found[-1] = (other[1], end, trend, corner, peak)
            continue
        if not back and 1 in slow and slack_mm[1 - mine] <= UNCUT_CROSSING * (other[1] - end):
            continue
        after = [turn[0] for turn in both[mine][i + 1 : i + 2]] + [turn[0] for turn in both[1 - mine] if turn[4] > peak]
        long = min(AGREED_MM, s_mm[at + 1] - peak, *[begin - peak for begin in after])
        if long >= SHORTEST_MM and LEAST_MM <= most <= FASTEST_AT_CORNER * long:
            into, out = np.abs(np.diff(belts_mm[at - 1 : at + 2], axis=0))
            way = np.array(slack_mm) + out * long / (s_mm[at + 1] - peak)
            straight = into @ way >= STRAIGHT_BACK * np.linalg.norm(into) * np.linalg.norm(way)
            waits = straight and mine == (1 if into[0] < into[1] else 0)
            found[-1] = (peak + (WAIT * long if waits else 0.0), peak + long, trend, peak, peak)
        elif back:
            found[-1] = (peak, peak, trend, peak, peak)
    return found


def joined(
    turns_: list[tuple], others: list[tuple], s_mm: np.ndarray, belt_mm: np.ndarray, other_mm: np.ndarray
) -> list[tuple]:
    """Return the agreed turns of one motor; one that ends at another's corner goes on until that has been taken up."""
    found = list(turns_)
    for begin, end, _, corner, _ in others:
        if begin != corner or end == corner:
            continue
        i = next((i for i, turn in enumerate(found) if turn[1] >= corner - NEAR_MM), None)
        if i is None or found[i][3] < np.inf or found[i][0] > corner - NEAR_MM or found[i][1] > end:
            continue
        after = found[i + 1][0] if i + 1 < len(found) else np.inf
        way, fall = (np.interp(end, s_mm, b) - np.interp(corner, s_mm, b) for b in (belt_mm, other_mm))
        if after >= end and found[i][2] * way > 0 and abs(fall) > 0:
            found[i] = (found[i][0], end, found[i][2], corner, found[i][4])
    return found


def around(
    s_mm: np.ndarray, belt_mm: np.ndarray, at: int, trend: int, other_mm: np.ndarray, slack_mm: float, floor_mm: float
) -> tuple[float, float] | None:
    """Return the stretch from before a corner to behind it, its tip cut off; None where the other belt rests."""
    if at == 0:
        return None
    (fall_in, across_in), (fall_out, across_out) = (
        (abs(belt_mm[at] - belt_mm[b]), abs(other_mm[at] - other_mm[b])) for b in (at - 1, at + 1)
    )
    aslant = [np.hypot(f, a) / max(a, 1e-9) for f, a in ((fall_in, across_in), (fall_out, across_out))]
    drop, tip = 2 * EPS_MM * min(ASLANT, aslant[1]), 2 * EPS_MM * min(ASLANT, *aslant)
    if min(fall_in, fall_out) < LEAST_FALL * tip or tip * across_in / fall_in < SIDEWAYS_MM or slack_mm < LEAST_MM:
        return None
    begins = [s_mm[at] - ahead * tip * (s_mm[at] - s_mm[at - 1]) / fall_in for ahead in (1.8, 1)]
    begin = begins[0] if begins[0] >= floor_mm else begins[1]
    end = s_mm[at] + (tip + drop) * (s_mm[at + 1] - s_mm[at]) / fall_out
    return (begin, end) if begin >= floor_mm and slack_mm <= FASTEST_AT_CORNER * (end - begin) else None


def corner_side(
    s_mm: np.ndarray, belt_mm: np.ndarray, at: int, trend: int, other_mm: np.ndarray, floor_mm: float
) -> tuple[float, float]:
    """Return the stretch to one side of the peak on which the other belt goes further."""
    best, most = (s_mm[at], s_mm[at]), -1.0
    for beside in (at + 1, at - 1):
        if not 0 <= beside < len(s_mm) or (beside < at and s_mm[at] <= floor_mm):
            continue
        side = beside - at
        while 0 <= beside + side < len(s_mm) and abs(belt_mm[beside] - belt_mm[at]) <= ASLANT * 2 * EPS_MM:
            beside += side
        fall, across = abs(belt_mm[beside] - belt_mm[at]), abs(other_mm[beside] - other_mm[at])
        aslant = 2 * EPS_MM * min(ASLANT, np.hypot(fall, across) / max(across, 1e-9))
        drop = aslant if fall > aslant and beside == at + side else 2 * EPS_MM
        cut = 0.0
        if at > 0 and s_mm[at] > floor_mm and fall > drop + 2 * EPS_MM:  # the belt stops ahead, or short of the tip
            cut = 2 * EPS_MM if abs(belt_mm[at - 1] - belt_mm[at]) > LEAST_FALL * 2 * EPS_MM else 0.0
        begin, end = stretch(s_mm, belt_mm, at, trend, drop + cut, floor_mm)
        if side < 0 < cut and begin <= floor_mm + NEAR_MM:
            begin, end = stretch(s_mm, belt_mm, at, trend, drop, floor_mm)
        begin, end = (s_mm[at], end) if beside > at else (begin, s_mm[at])
        sideways = abs(np.interp(end, s_mm, other_mm) - np.interp(begin, s_mm, other_mm))
        if sideways > most:
            best, most = (begin, end), sideways
    return best


def stretch(
    s_mm: np.ndarray, belt_mm: np.ndarray, at: int, trend: int, drop_mm: float, floor_mm: float
) -> tuple[float, float]:
    """Walk away from the peak in small steps for as long as the belt is no more than ``drop_mm`` below it.

    Backwards no further than to a move that goes upright to the peak.
    """
    ends = []
    upright = [a for a in range(1, at + 1) if abs(belt_mm[a] - belt_mm[a - 1]) >= UPRIGHT * (s_mm[a] - s_mm[a - 1])]
    first = max(floor_mm, s_mm[upright[-1]] if upright else 0.0)
    for way, limit in ((-1, first), (1, s_mm[-1])):
        s = s_mm[at] + way * PITCH_MM * np.arange(int(abs(limit - s_mm[at]) / PITCH_MM) + 1)
        fallen = np.flatnonzero(trend * (belt_mm[at] - np.interp(s, s_mm, belt_mm)) > drop_mm)
        ends.append(s[fallen[0] - 1] if len(fallen) else limit)
    return ends[0], ends[1]
