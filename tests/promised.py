"""What the tests of promises share: printers with and without faults, their measurements, and a part."""

from dataclasses import replace

import numpy as np

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.path import Instrument, Trace
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from tests.test_greybox_learning import stairs

ENDER3 = read_printer("ender3")
HEALTHY = Corruption((Drive(), Drive()))
BENT = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.3)), Drive(belt=Play(0.2))))
CIRCLE = "G21\nG90\nM83\nG28\nG1 Z0.2 F600\nG0 X140 Y110 F6000\n" + "".join(
    f"G1 X{110 + 30 * np.cos(t):.3f} Y{110 + 25 * np.sin(t):.3f} E0.05 F1800\n"
    for t in np.linspace(0, 2 * np.pi, 181)[1:]
)


def measured(corruption: Corruption, noise_mm: float, seed: int, points: int = 350, printer: Printer = ENDER3) -> Trace:
    """Return the marks of a printer, on a way over all of its bed."""
    way = stairs(points)
    noise = np.random.default_rng(seed).normal(0, noise_mm, way.shape)
    return Trace(way, Twin.of(corruption, printer).follow(way) + noise, homed=True)


def scanned(trace: Trace, stretch: np.ndarray, instrument: Instrument | None = None) -> Trace:
    """Return the trace as an instrument sees it that stretches and knows no place."""
    moved = (trace.measured_mm - 100.0) @ (np.eye(2) + stretch).T + [95.0, 104.0]
    return replace(trace, measured_mm=moved, placed=False, instrument=instrument)
