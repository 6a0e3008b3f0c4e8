"""A broken printer that executes micro-steps, written from the words of its TOML file; shares no code with printmend.

Physics as in docs/corruptions.md. A motor's steps come in; where the plastic lands comes out. The belts' play is worked
off run by run of equal direction, not step by step, and nothing is tabulated but the micro-steps that were taken.
"""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_TURN = 2 * math.pi
_FINE = 65536  # samples of a pulley's turn
Branch = Callable[[np.ndarray], np.ndarray]


def _outline(pulley: dict, radius_mm: float) -> np.ndarray:
    """Return the support function of a pulley's hull at `_FINE` angles from 0."""
    phi = np.arange(_FINE) * _TURN / _FINE
    kind = pulley["kind"]
    turned = phi - pulley.get("phase_rad", 0.0)
    r = pulley.get("radius_mm", radius_mm)
    if kind == "radius":
        return np.full(_FINE, r)
    if kind == "eccentric":
        return r + pulley["eccentricity_mm"] * np.cos(turned)
    if kind == "ellipse":
        return np.sqrt((pulley["a_mm"] * np.cos(turned)) ** 2 + (pulley["b_mm"] * np.sin(turned)) ** 2)
    if kind == "polygon":
        n = len(pulley["radii_mm"])
        return np.max([c * np.cos(turned - _TURN * i / n) for i, c in enumerate(pulley["radii_mm"])], axis=0)
    if kind == "flat":
        half = math.acos((r - pulley["depth_mm"]) / r)
        away = np.abs((turned + math.pi) % _TURN - math.pi)
        return np.where(away < half, r * np.cos(half - away), r)
    if kind == "fourier":
        k = np.arange(1, len(pulley["cos_mm"]) + 1)[:, None]
        waves = np.array(pulley["cos_mm"])[:, None] * np.cos(k * phi) + np.array(pulley["sin_mm"])[:, None] * np.sin(
            k * phi
        )
        return pulley["radius_mm"] + waves.sum(axis=0)
    if kind == "tabulated":
        heights = pulley["heights_mm"]
        return np.interp(phi, np.arange(len(heights) + 1) * _TURN / len(heights), [*heights, heights[0]])
    raise ValueError(f"no such pulley here: {kind}")


def _unwound(outline: np.ndarray, side: float, turn_mm: float) -> Branch:
    """Return ∫ h(side − θ) dθ over the motor's position [mm]."""
    grid = np.linspace(0.0, _TURN, _FINE + 1)
    h = np.interp(np.mod(side - grid, _TURN), np.append(np.arange(_FINE) * _TURN / _FINE, _TURN),
                  np.append(outline, outline[0]))  # fmt: skip
    total = np.concatenate([[0.0], np.cumsum((h[1:] + h[:-1]) / 2)]) * _TURN / _FINE

    def unwound(motor_mm: np.ndarray) -> np.ndarray:
        turns, rest = np.divmod(motor_mm / turn_mm, 1.0)
        return turns * total[-1] + np.interp(rest * _TURN, grid, total)

    return unwound


def _branches(drive: dict, turn_mm: float, step_mm: float) -> tuple[Branch, Branch]:
    """Return what pushes the carriage forwards, and what draws it back, over the motor's position."""

    def rotor(m: np.ndarray) -> np.ndarray:
        lead = np.zeros_like(m)
        if ripple := drive.get("ripple"):
            for a, p, phase in zip(ripple["amplitude_steps"], ripple["period_steps"], ripple["phase_rad"], strict=True):
                lead += a * np.sin(_TURN * m / step_mm / p + phase)
        return m + step_mm * lead

    span1: Branch = rotor
    span2: Branch = rotor
    if "pulley" in drive:
        outline = _outline(drive["pulley"], turn_mm / _TURN)
        near, far = _unwound(outline, 0.0, turn_mm), _unwound(outline, math.pi, turn_mm)
        span1, span2 = (lambda m: near(rotor(m))), (lambda m: far(rotor(m)))
    belt = drive.get("belt", {"kind": "taut"})
    ends = {"taut": (0.0, 0.0), "play": (belt.get("play_mm", 0.0) / 2,) * 2,
            "loose": (belt.get("slack1_mm", 0.0), belt.get("slack2_mm", 0.0))}  # fmt: skip
    if belt["kind"] == "elastic":
        stretched = _elastic(belt, span1, span2, step_mm)
        pushed, drawn = stretched, stretched
    else:
        back, forth = ends[belt["kind"]]
        other = span2 if belt["kind"] == "loose" else span1
        pushed, drawn = (lambda m: span1(m) - back), (lambda m: other(m) + forth)
    half_mm = drive.get("shaft", {"slack_rad": 0.0})["slack_rad"] * turn_mm / _TURN / 2

    def aside(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lost, off = np.zeros_like(m), np.zeros_like(m)
        if friction := drive.get("friction"):
            length = np.clip(np.abs(m - friction.get("motor_mm", -20.0)), 0.0, friction["loop_mm"])
            most = 2 * friction["force_n"] / friction["stiffness_n"]
            lost = most * length * (friction["loop_mm"] - length) / friction["loop_mm"]
        if warp := drive.get("warp"):
            for i, bump in enumerate(warp["bumps_mm"]):
                away = (m - warp.get("first_mm", 0.0)) / warp["spacing_mm"] - i
                off += bump * np.exp(-(away**2) / 2)
        return lost / 2, off

    return (
        lambda m: pushed(m - half_mm) - aside(m)[0] + aside(m)[1],
        lambda m: drawn(m + half_mm) + aside(m)[0] + aside(m)[1],
    )


def _elastic(belt: dict, span1: Branch, span2: Branch, step_mm: float) -> Branch:
    """A taut loop of rubber: the odd part of the pulley fades with the distance from the motor."""
    grid = np.arange(-1000.0, 1500.0, step_mm / 64)
    length = np.clip(np.abs((grid[1:] + grid[:-1]) / 2 - belt.get("motor_mm", -20.0)), 0.0, belt["loop_mm"])
    step1, step2 = np.diff(span1(grid)), np.diff(span2(grid))
    share = 1 - 2 * length / belt["loop_mm"]
    place = np.concatenate([[0.0], np.cumsum((step1 + step2) / 2 + share * (step1 - step2) / 2)])
    return lambda m: np.interp(m, grid, place)


def follow(motor_mm: np.ndarray, pushed: Branch, drawn: Branch, start_mm: float) -> np.ndarray:
    """Return where the belt is [N] after each of the motor's positions [N]; it begins at ``start_mm`` at the first."""
    places, where = np.unique(np.rint(motor_mm * 1e6).astype(np.int64), return_inverse=True)
    lower, upper = pushed(places / 1e6)[where], drawn(places / 1e6)[where]
    way = np.sign(np.diff(motor_mm, prepend=motor_mm[0]))
    way = way[np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), 0))]  # who stands goes on as before
    way[: int(np.argmax(way != 0))] = way[np.argmax(way != 0)] or 1.0
    first = np.flatnonzero(np.diff(way, prepend=0.0))  # of each run in one direction
    last = np.append(first[1:], len(way)) - 1
    u, starts = start_mm, np.empty(len(first))
    for run, (forwards, low, high) in enumerate(
        zip((way[first] > 0).tolist(), lower[last].tolist(), upper[last].tolist(), strict=True)
    ):
        starts[run] = u
        u = max(u, low) if forwards else min(u, high)
    held = np.repeat(starts, last - first + 1)
    return np.where(way > 0, np.maximum(held, lower), np.minimum(held, upper))


@dataclass(frozen=True, eq=False)
class TruePrinter:
    """A broken printer of known geometry; ``fault`` is the table of its TOML file."""

    fault: dict
    corexy: bool
    home_mm: tuple[float, float, float]
    home_sides: tuple[int, int]
    turn_mm: tuple[float, float, float]
    step_mm: tuple[float, float]
    middle_mm: tuple[float, float]

    @classmethod
    def of(cls, toml: str, printer) -> "TruePrinter":
        """Take the printer's plain numbers."""
        x, y, z = printer.axes
        sides = [1 if axis.home_side == "max" else -1 for axis in (x, y)]
        corexy = printer.kinematics == "corexy"
        return cls(
            tomllib.loads(toml), corexy, (x.home_mm, y.home_mm, z.home_mm),
            (sides[1], -sides[1]) if corexy else (sides[0], sides[1]),
            (x.mm_per_turn, y.mm_per_turn, z.mm_per_turn),
            (x.mm_per_turn / x.steps_per_turn, y.mm_per_turn / y.steps_per_turn),
            ((x.min_mm + x.max_mm) / 2, (y.min_mm + y.max_mm) / 2),
        )  # fmt: skip

    def belts(self, motors_mm: tuple[np.ndarray, np.ndarray]) -> list[np.ndarray]:
        """Return where both belts are after each step; both motors start at home, where the end stop left them."""
        x, y = self.home_mm[:2]
        at = (x + y, x - y) if self.corexy else (x, y)
        bx, by = self._unframed(x, y)
        wanted = (bx + by, bx - by) if self.corexy else (bx, by)
        found = []
        for k, motor in enumerate(motors_mm):
            pushed, drawn = _branches(self.fault.get("xy"[k], {}), self.turn_mm[k], self.step_mm[k])
            engaged = float((pushed if self.home_sides[k] > 0 else drawn)(np.array([at[k]]))[0])
            way = follow(np.concatenate([[at[k]], motor]), pushed, drawn, engaged)
            found.append(way + (wanted[k] - engaged))
        return found

    def framed(self, belts_mm: np.ndarray) -> np.ndarray:
        """Return the places on the bed [N, 2] of belts' places [N, 2]."""
        x, y = belts_mm.T if not self.corexy else ((belts_mm[:, 0] + s * belts_mm[:, 1]) / 2 for s in (1, -1))
        return np.stack(self._frame(x, y), axis=1)

    def _frame(self, x, y):
        frame = self.fault.get("frame")
        if frame is None:
            return x, y
        skew = math.tan(math.radians(frame.get("skew_deg", 0.0)))
        dx, dy = x / 100 - self.middle_mm[0] / 100, y / 100 - self.middle_mm[1] / 100
        return (
            frame.get("x_scale", 1.0) * x + skew * y + frame.get("x_bow_mm", 0.0) * dy**2,
            frame.get("y_scale", 1.0) * y + frame.get("y_bow_mm", 0.0) * dx**2,
        )

    def _unframed(self, x: float, y: float) -> tuple[float, float]:
        bx, by = x, y
        for _ in range(200):
            fx, fy = self._frame(bx, by)
            bx, by = bx + x - fx, by + y - fy
        return bx, by

    def heights(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the nozzle's height [N] and the screw's push [N, 2] after each of Z's positions, from home on."""
        screw, home, lead = self.fault.get("z", {}).get("screw"), self.home_mm[2], self.turn_mm[2]
        motor = np.concatenate([[home], motor_mm])
        if screw is None:
            return motor, np.zeros((len(motor), 2))
        half = screw.get("backlash_mm", 0.0) / 2

        def height(m: np.ndarray) -> np.ndarray:
            wave = screw.get("periodic_mm", 0.0) * np.sin(_TURN * m / lead + screw.get("periodic_phase_rad", 0.0))
            return m * (1 + screw.get("lead_error", 0.0)) + wave

        def push(m: np.ndarray) -> np.ndarray:
            phase = _TURN * m / lead + screw.get("wobble_phase_rad", 0.0)
            return screw.get("wobble_mm", 0.0) * np.stack([np.cos(phase), np.sin(phase)], axis=-1)

        engaged = float(height(np.array([home]))[0]) + half  # homed downwards: the nut hangs on its upper side
        z = follow(motor, lambda m: height(m) - half, lambda m: height(m) + half, engaged)
        return z + home - engaged, push(motor) - push(np.array([home]))
