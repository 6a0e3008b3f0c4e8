"""Slow, obvious version of where the motors turn back on a path, and of the stretch on which their slack is crossed."""

import numpy as np

EPS_MM, FLAT_MM, LEAST_MM, GENTLE, FLATTEST, STEEPEST = 0.005, 2e-4, 0.08, 0.75, 0.5, 8.0
PITCH_MM = 2e-4


def turns(s_mm: np.ndarray, belt_mm: np.ndarray, slack_mm: float) -> list[tuple[float, float, int]]:
    """Return (begin, end, trend after) of each reversal of more than 10 µm of a belt along a polyline of nodes [N]."""
    found, floor = [], 0.0
    at, trend = 0, 0
    for i in range(1, len(belt_mm)):
        if trend == 0 and abs(belt_mm[i] - belt_mm[0]) > 2 * EPS_MM:
            at, trend = i, int(np.sign(belt_mm[i] - belt_mm[0]))
        elif trend and trend * belt_mm[i] >= trend * belt_mm[at]:
            at = i
        elif trend and trend * (belt_mm[at] - belt_mm[i]) > 2 * EPS_MM:
            begin, end = stretch(s_mm, belt_mm, at, trend, FLAT_MM, floor)
            if slack_mm > FLATTEST * (end - begin):
                begin, end = stretch(s_mm, belt_mm, at, trend, EPS_MM, floor)
            if slack_mm > GENTLE * (end - begin):
                begin, end = stretch(s_mm, belt_mm, at, trend, 2 * EPS_MM, floor)
            long = end - begin
            if long < 0.02 or long + slack_mm < LEAST_MM or slack_mm > STEEPEST * long:
                begin = end = s_mm[at]
            elif (inside := s_mm[(s_mm >= begin) & (s_mm <= end)]).size:
                first, last = inside.min(), inside.max()
                choices = [(first, last), *sorted([(first, end), (begin, last)], key=lambda c: c[0] - c[1])]
                gentle = [c for c in choices if slack_mm <= GENTLE * (c[1] - c[0])]
                begin, end = gentle[0] if gentle else (begin, end)
            found.append((begin, end, -trend))
            floor, at, trend = end, i, -trend
    return found


def stretch(
    s_mm: np.ndarray, belt_mm: np.ndarray, at: int, trend: int, drop_mm: float, floor_mm: float
) -> tuple[float, float]:
    """Walk away from the peak in small steps for as long as the belt is no more than ``drop_mm`` below it."""
    ends = []
    for way, limit in ((-1, floor_mm), (1, s_mm[-1])):
        s = s_mm[at] + way * PITCH_MM * np.arange(int(abs(limit - s_mm[at]) / PITCH_MM) + 1)
        fallen = np.flatnonzero(trend * (belt_mm[at] - np.interp(s, s_mm, belt_mm)) > drop_mm)
        ends.append(s[fallen[0] - 1] if len(fallen) else limit)
    return ends[0], ends[1]
