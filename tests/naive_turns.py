"""Slow, obvious version of where the motors turn back on a path, and of the stretch on which their slack is crossed."""

import numpy as np

EPS_MM, FLAT_MM, LEAST_MM, FLATTEST, GENTLE, UNCUT, STEEPEST = 0.005, 2e-4, 0.08, 0.5, 0.5, 0.75, 8.0
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
            way = s_mm[: i + 1], belt_mm[: i + 1], at, trend
            begin, end = stretch(*way, FLAT_MM, floor)
            if slack_mm > FLATTEST * (end - begin):
                begin, end = stretch(*way, EPS_MM, floor)
            if slack_mm > GENTLE * (end - begin):
                begin, end = stretch(*way, 2 * EPS_MM, floor)
            inside = s_mm[(s_mm >= begin) & (s_mm <= end)]
            first, last = (inside.min(), inside.max()) if inside.size else (end, begin)
            choices = [(first, last), *sorted([(first, end), (begin, last)], key=lambda c: c[0] - c[1])]
            uncut = [c for c in choices if c[1] > c[0] and slack_mm <= UNCUT * (c[1] - c[0])]
            if not may_cross(begin, end, slack_mm):
                begin = end = s_mm[at]
            elif uncut:
                begin, end = uncut[0]
            found.append((begin, end, -trend))
            floor, at, trend = end, i, -trend
    return found


def may_cross(begin_mm: float, end_mm: float, slack_mm: float) -> bool:
    """Say whether the stretch is long enough for firmwares, and the motor not much faster than the nozzle."""
    long = end_mm - begin_mm
    return long >= 0.02 and long + slack_mm >= LEAST_MM and slack_mm <= STEEPEST * long


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
