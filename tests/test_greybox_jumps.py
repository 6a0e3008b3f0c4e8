"""Jumps in a trace: the compiled ladder against a slow one, and what a learner makes of skipped teeth."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption.transmission import MissedSteps, ToothSkips
from printmend.machine import Transmission, healthy_mechanism
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import drawn_body
from printmend_lab.greybox import Greybox, motor_rows
from printmend_lab.greybox.drive.jumps import Jump, lasting
from printmend_lab.greybox.drive.kernels import cheapest_levels
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample
from tests.naive_greybox import cheapest_history

ZIGZAG_MM = np.array([[20.0, 30.0], [190.0, 180.0], [25.0, 35.0], [185.0, 60.0], [30.0, 170.0], [120.0, 40.0]])


@pytest.mark.parametrize("seed", range(5))
def test_the_ladder_is_climbed_at_the_least_cost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost, path = rng.exponential(2.0, (5, 3, 5)), np.empty((5, 2), np.int64)
    least = cheapest_levels(cost, 0.7, path)
    slow, history = cheapest_history(cost, 0.7)
    assert least == pytest.approx(slow)
    assert path.tolist() == [list(level) for level in history]


@pytest.mark.parametrize("family", ["play", "pulley"])
def test_a_machine_is_learned_in_spite_of_jumps(family: str) -> None:
    printer, rng = read_printer("ender3"), np.random.default_rng(8)
    fault = sample(family, rng)
    jumping = replace(
        fault,
        drives=tuple(replace(drive, skips=ToothSkips(3.0, 5 + i), missed=MissedSteps(3.0, 7 + i))
                     for i, drive in enumerate(fault.drives)),
    )  # fmt: skip
    at = np.concatenate([np.linspace(a, b, 120, endpoint=False) for a, b in itertools.pairwise(ZIGZAG_MM)])
    points = np.concatenate([[printer.home_mm], at])
    noise = rng.normal(0, 0.03, points.shape)
    calm, wild = (Twin.of(each, printer).follow(points) + noise for each in (fault, jumping))
    assert np.abs(wild - calm).max() > 1.9
    found = Greybox().fit(Trace(points, wild), printer, rng=rng)
    assert sum(map(len, found.jumps)) >= 4
    plain = Greybox().fit(Trace(points, calm), printer, rng=rng)
    assert not any(plain.jumps)
    for one, other in zip(found.drives, plain.drives, strict=True):
        motor = np.linspace(40.0, 160.0, 200)
        for mine, wanted in zip(one.branches.errors_mm(motor), other.branches.errors_mm(motor), strict=True):
            np.testing.assert_allclose(mine - mine.mean(), wanted - wanted.mean(), atol=0.08)


@pytest.mark.parametrize(("family", "seed"), [("tabulated", 1), ("polygon", 2), ("pulley-play", 6)])
def test_a_few_jumps_of_a_layer_are_found_and_snapped(family: str, seed: int) -> None:
    printer, rng = read_printer("ender5"), np.random.default_rng(seed)
    twin = Twin.of(sample(family, rng), printer)
    layer = drawn_body(rng, printer, size_mm=50.0).layers[0]
    third = layer.transitions // 3
    events = ([(third, True, 10), (third + 700, False, -4)], [(2 * third, False, 4)])

    controls, belts = layer.controls.astype(np.int64), np.zeros((layer.transitions + 1, 2))
    for axis, of_axis in enumerate(events):
        for row, is_belt, steps in of_axis:
            if is_belt:
                belts[row:, axis] += steps
            else:
                controls[row - 1, axis] += steps
    trace = layer_trace(layer, twin.run(controls, layer.start_steps) + belts, printer)
    noisy = replace(trace, measured_mm=trace.measured_mm + rng.normal(0, 0.05, trace.measured_mm.shape))

    found = Greybox().fit(noisy, printer, rng=np.random.default_rng(0)).jumps
    for mine, of_axis in zip(found, events, strict=True):
        assert [(jump.belt, round(jump.size_mm / 0.2)) for jump in mine] == [event[1:] for event in of_axis]
        for jump, (row, _, _) in zip(mine, of_axis, strict=True):
            assert isinstance(jump, Jump)
            assert abs(jump.row - row) <= 20  # play may hide it for a while


def test_what_is_undone_wherever_it_is_passed_belongs_to_the_place() -> None:
    printer = read_printer("ender5")
    motor = np.concatenate([np.linspace(60, 140, 200), np.linspace(140, 60, 200)] * 4)
    points = np.column_stack([motor, np.full(len(motor), 100.0)])
    rows = motor_rows(Trace(points, points), printer)[0]
    place = [Jump(200 * i + 100, i > 5, 0.8 if i % 2 == 0 else -0.8) for i in range(8) if i != 3]
    true = [Jump(301, False, 0.8), Jump(702, True, -2.0), Jump(1150, False, 0.8)]  # the first at the same place
    none = [Jump(450, True, 2.0), Jump(450, False, -1.6)]
    assert lasting(rows, place) == ()
    assert lasting(rows, sorted([*place, *true, *none], key=lambda jump: jump.row)) == tuple(true)
    assert lasting(rows, true) == tuple(true)
    assert lasting(rows, ()) == ()


def test_splices_are_no_lost_steps_and_hide_none() -> None:
    printer, rng = read_printer("ender5"), np.random.default_rng(2)
    healthy, tables = healthy_mechanism(printer), []
    for table in healthy.transmissions:
        away_mm = table.motor_mm - rng.uniform(0, 220, (6, 1))
        bend_mm = (rng.uniform(0.1, 0.4, (6, 1)) * np.tanh(away_mm / 0.3)).sum(axis=0)
        tables.append(Transmission(table.first_mm, table.pitch_mm, table.lower_mm + bend_mm, table.upper_mm + bend_mm))
    twin = Twin(replace(healthy, transmissions=(tables[0], tables[1])))
    layer = drawn_body(rng, printer, size_mm=100.0).layers[0]
    for lost in (0, 4):
        controls = layer.controls.astype(np.int64)
        controls[3000] -= lost
        trace = layer_trace(layer, twin.run(controls, layer.start_steps), printer)
        noisy = replace(trace, measured_mm=trace.measured_mm + rng.normal(0, 0.05, trace.measured_mm.shape))
        for jumps in Greybox().fit(noisy, printer, rng=np.random.default_rng(0)).jumps:
            assert [(jump.belt, round(jump.size_mm / 0.2)) for jump in jumps] == [(False, -4)] * (lost > 0)
            assert all(abs(jump.row - 3001) <= 20 for jump in jumps)
