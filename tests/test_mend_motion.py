"""Every kind of motion: arcs, helices, vase mode, z-hops, single axes, tiny segments."""

import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive
from printmend.corruption.transmission import Play
from printmend.gcode.kernels import RECORD
from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.read import interpret_text, read_gcode, straightened
from printmend.jit import record
from printmend.plan import layout, lookup, start
from printmend.plan.kernels import mend as mend_kernels
from printmend.plan.kernels import travel as kernels
from tests import naive_mend
from tests.mending import BENT, COREXY, ENDER3, PLAY, START, Judged, judge, mended

COREXY_PLAY = Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.7)))).lower(COREXY).homed()
MODELS = pytest.mark.parametrize("mechanism", [PLAY, BENT], ids=["play", "bent"])
ARCS = {
    "quarter": b"G3 X80 Y80 I0 J20 E2 F1800\n",
    "clockwise": b"G2 X80 Y60 I10 J0 E2 F1800\n",
    "most of a circle": b"G2 X60 Y80 I20 J10 E4 F1800\n",
    "full circle": b"G2 X60 Y60 I15 J5 E5 F1800\n",
    "full circle, axes not named": b"G3 I15 J5 E5 F1800\n",
    "radius": b"G2 X80 Y70 R15 E2 F1800\n",
    "long way by radius": b"G3 X80 Y70 R-15 E4 F1800\n",
    "small": b"G2 X61 Y60 I0.5 J0 E.1 F1800\n",
}


def right(judged: Judged, most_mm: float = 0.012) -> None:
    assert naive_mend.rms(judged.before) > 0.08
    assert judged.rms_mm <= 0.006
    assert judged.after.max() <= most_mm
    wanted = sum(move.filament for move in judged.wanted)
    assert sum(move.filament for move in judged.given) == pytest.approx(wanted, abs=1e-4)


@MODELS
@pytest.mark.parametrize("name", ARCS)
def test_arcs(mechanism, name: str) -> None:
    judged = judge(START + ARCS[name] + b"G1 X62 Y50 E1\n", mechanism)
    right(judged)
    places = np.array([end[:2] for move in judged.wanted if move.draws for end in (move.start, move.end)])
    low, high = judged.prediction.printed_low_mm, judged.prediction.printed_high_mm
    assert (*low, *high) == pytest.approx((*places.min(axis=0), *places.max(axis=0)), abs=0.01)


@MODELS
def test_all_turns_of_an_arc_are_drawn_once(mechanism) -> None:
    text = START + b"G1 X80 Y60 E1 F1800\nG2 X80 Y60 I10 J3 P3 E6\n"
    written, _ = mended(text, mechanism, Flavour.UNKNOWN)
    drawn = [straightened(read_gcode(each, printer=ENDER3).moves, 0.002) for each in (text, written)]
    lengths = [np.linalg.norm(each.end_mm - each.start_mm, axis=1)[each.extruding].sum() for each in drawn]
    assert lengths[1] == pytest.approx(lengths[0], rel=0.05)


@pytest.mark.parametrize("name", ARCS)
def test_arcs_stay_arcs_where_only_play_is_wrong(name: str) -> None:
    moves = naive_mend.read_moves(mended(START + ARCS[name], PLAY)[0], (0.0, 0.0, 0.0))
    text = mended(START + ARCS[name], PLAY)[0]
    drawn = [line for line in text.splitlines() if b"E" in line]
    arcs = [line for line in drawn if line.startswith((b"G2 ", b"G3 "))]
    assert 1 <= len(arcs) <= 6  # one for each quadrant
    # Where an axis turns back, its slack is crossed on a short chord: 2 √(2 R ε) of path, or less.
    straight = [text.splitlines().index(line) for line in drawn if line not in arcs]
    assert all(move.length <= 1.5 for move in moves if move.draws and move.line in straight)
    assert len(straight) <= 5


def test_arcs_become_a_few_arcs_otherwise() -> None:
    text = mended(START + ARCS["quarter"], BENT)[0]
    drawn = [line for line in text.splitlines() if b"E" in line]
    assert all(line.startswith(b"G3 ") for line in drawn)
    # a chord of 0.005 mm on a radius of 20 mm is 0.9 mm long; the quarter has 31 mm
    assert 2 <= len(drawn) < 31 / 0.9 / 4
    right(judge(START + ARCS["quarter"], BENT))


def test_relative_arcs_and_centres() -> None:
    right(judge(START + b"G91\nG2 X20 Y0 I10 J0 E2 F1800\nG3 X-10 Y5 I-5 J2 E2\nG90\nG1 X60 Y60 E1\n", PLAY))


@MODELS
def test_helix(mechanism) -> None:
    judged = judge(START + b"G2 X80 Y60 Z0.21 I10 J0 E2 F1800\n", mechanism)
    right(judged)
    heights = [move.end[2] for move in judged.given if move.draws]
    assert heights == sorted(heights)
    assert heights[-1] == pytest.approx(0.21)


def test_spiral_lift_draws_nothing() -> None:
    """Bambu's z-hop: a full circle that rises; it must still end where the next line begins."""
    text = (
        START + b"G1 X80 E1 F1800\nG1 E-.8 F1800\nG17\nG3 Z0.6 I1.2 J0.2 P1 F9000\n"
        b"G1 X60 Y65 F9000\nG1 Z.2\nG1 E.8 F1800\nG1 X80 E1\n"
    )
    right(judge(text, PLAY))
    right(judge(text, BENT))


def test_other_planes() -> None:
    text = START + b"G18\nG3 X70 Z0.2 I5 K0 E1 F1800\nG17\nG1 X80 Y70 E1\n"
    written, prediction = mended(text, BENT)
    assert prediction.after.rms_mm < 0.01
    tops = [float(z) for z in re.findall(rb"Z(-?[\d.]+)", written)]
    assert max(tops) == pytest.approx(5.2, abs=0.02)


@MODELS
@pytest.mark.parametrize("arc", [b"G2 X80 Y60 I10 J0 P900 E13000\n", b"G18\nG3 X80 Z0.2 I10 K0 P900 E1\n"])
def test_no_move_becomes_more_pieces_than_there_is_room_for(mechanism, arc: bytes) -> None:
    planner = start(mechanism)
    records = interpret_text(np.frombuffer(START + b"G1 F1800\n" + arc, np.uint8), initial_state(ENDER3))
    end, first, _ = planner.plan(records)
    assert end == len(records)
    assert 1000 < first[end] - first[end - 1] < 1.5 * layout.CHORDS_A_RECORD


@MODELS
@pytest.mark.parametrize(
    "line", [b"G2 X80 Y60 I10 J0 P99 Z0.2 E50\n", b"G5 X80 Y60 I3 J9 P-3 Q9 Z1 E3\n", b"G1 X80 E9\n"]
)
def test_a_line_from_beyond_all_printers_is_left(mechanism, line: bytes) -> None:
    prediction = mended(START + b"G1 Z999999999999999 F1800\n" + line, mechanism)[1]
    assert prediction.unknown > 0
    assert prediction.commands < 1100


def test_vase() -> None:
    t = np.linspace(0, 6 * np.pi, 240)
    rows = [
        f"G1 X{70 + 10 * math.cos(a):.3f} Y{70 + 10 * math.sin(a):.3f} Z{0.2 + 0.2 * a / 6.2832:.4f} E0.03" for a in t
    ]
    text = START + b"G0 X80 Y70\nG1 F1500\n" + "\n".join(rows).encode() + b"\n"
    for mechanism in (PLAY, BENT):
        judged = judge(text, mechanism)
        assert judged.rms_mm <= 0.006
        heights = [move.end[2] for move in judged.given if move.draws]
        assert heights == sorted(heights)


@MODELS
def test_z_hop_and_travels(mechanism) -> None:
    hop = b"G1 E-1 F2400\nG1 Z.6 F600\nG0 X%d Y%d F7200\nG1 Z.2 F600\nG1 E1 F2400\nG1 X%d Y%d E1 F1800\n"
    text = START + b"".join(hop % row for row in ((70, 60, 60, 64), (65, 80, 75, 70), (80, 62, 70, 62)))
    right(judge(text, mechanism))


@MODELS
def test_single_axes(mechanism) -> None:
    right(judge(START + b"G1 X80 E1 F1800\nG1 Y80 E1\nG0 X70 F6000\nG0 Y62\nG1 X60 E1 F1800\nG1 Y80 E1\n", mechanism))


@MODELS
def test_tiny_segments(mechanism) -> None:
    t = np.linspace(0, 4 * np.pi, 300)
    rows = [f"G1 X{60 + 4 * a:.3f} Y{60 + 3 * math.sin(a):.3f} E0.002" for a in t]
    judged = judge(START + b"G1 F1800\n" + "\n".join(rows).encode() + b"\n", mechanism)
    right(judged)
    assert judged.prediction.takeups == 4
    assert judged.prediction.commands < 1.02 * judged.prediction.moves + 6


@pytest.mark.parametrize("name", ["full circle", "quarter", "most of a circle"])
def test_arcs_on_a_corexy(name: str) -> None:
    from printmend.corruption import Corruption, Drive
    from printmend.corruption.transmission import Play

    play = Corruption((Drive(belt=Play(0.5)), Drive(belt=Play(0.3)))).lower(COREXY).homed()
    right(judge(START + ARCS[name] + b"G1 X62 Y50 E1\n", play))


def test_wipes_are_travels() -> None:
    text = START + b"G1 X80 E1 F1800\nG1 X75 E-.5 F6000\nG1 X70 E-.5\nG0 X60 Y70\nG1 E1\nG1 X80 E1 F1800\n"
    right(judge(text, BENT))


def test_moves_outside_the_bed_stay_where_they_were() -> None:
    """A purge line at X −2 is the owner's; nothing goes further out because of us."""
    text = START + b"G0 X-2 Y20 F6000\nG1 Y150 E10 F1500\nG1 X1 F3000\nG1 X30 E2\n"
    judged = judge(text, PLAY)
    assert min(move.end[0] for move in judged.given) == pytest.approx(-2.0)
    assert ENDER3.x.min_mm == 0


def wall(radius_mm: float, points: int) -> bytes:
    t = np.linspace(0, 4 * np.pi, points)
    rows = "".join(f"G1 X{90 + radius_mm * math.cos(a):.3f} Y{90 + radius_mm * math.sin(a):.3f} E.02\n" for a in t)
    return START + f"G0 X{90 + radius_mm} Y90 F6000\nG1 F1800\n".encode() + rows.encode()


@pytest.mark.parametrize("points", [60, 400])
@MODELS
def test_smooth_walls_are_drawn_without_a_stop(mechanism, points: int) -> None:
    """A slack is crossed where its axis turns back anyway; no command runs back on the one before."""
    judged = judge(wall(12.0, points), mechanism)
    right(judged)
    assert judged.prediction.takeups in (7, 8)  # the travel there may end on the right side
    assert judged.prediction.stops == 0
    assert judged.prediction.commands <= 1.3 * judged.prediction.moves
    ways = np.array([np.subtract(m.end[:2], m.start[:2]) for m in judged.given if m.draws])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    assert (ways[1:] * ways[:-1]).sum(axis=1).min() > 0.1  # 84 degrees


def test_only_where_the_path_goes_straight_back_the_nozzle_stops() -> None:
    text = START + b"G1 X80 Y80 E1 F1800\nG1 X60 Y85 E1\nG1 X60 Y105 E1\n"
    judged = judge(text + b"G1 X80 E1\nG1 X60 Y106 E1\n", PLAY)
    right(judged, 0.016)
    assert (judged.prediction.takeups, judged.prediction.stops) == (3, 0)
    judged = judge(text + b"G1 Y90 E1\n", PLAY)
    right(judged)
    assert (judged.prediction.takeups, judged.prediction.stops) == (2, 1)
    assert "places where the nozzle stops for a moment (a small seam): 1" in judged.prediction.summary()


def test_where_both_axes_go_back_the_command_does_not() -> None:
    """Both slacks together would go back on the line that came: one axis begins, then both go aside."""
    loose = Corruption((Drive(belt=Play(0.11)), Drive(belt=Play(0.17)))).lower(ENDER3).homed()
    judged = judge(START + b"G1 X70 Y76.5 E1 F1800\nG1 X60 Y66.5 E1\n", loose)
    assert judged.after.max() <= 0.016
    assert (judged.prediction.takeups, judged.prediction.stops) == (2, 0)
    drawn = [move for move in judged.given if move.draws]
    ways = np.array([np.subtract(move.end, move.start)[:2] for move in drawn])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert (ways[:-1] * ways[1:]).sum(axis=1).min() > -0.985
    assert ways[-2] @ ways[-1] > 0.9


def test_infill_goes_round_its_links_without_a_stop() -> None:
    """Two loose axes turn back at each link: nothing stops, and the command bends once, towards the next line."""
    loose = Corruption((Drive(belt=Play(0.12)), Drive(belt=Play(0.15)))).lower(ENDER3).homed()
    lines, x, y = [], 60.0, 60.0
    for i in range(24):
        x, y = x + (10 if i % 2 else -10), y + (10 if i % 2 else -10)
        lines.append(f"G1 X{x:g} Y{y:g} E.5 F3600")
        y += 0.5 if i % 2 else -0.5
        lines.append(f"G1 X{x:g} Y{y:g} E.02")
    judged = judge(START + "\n".join(lines).encode() + b"\n", loose)
    assert naive_mend.rms(judged.after) <= 0.006
    assert judged.after.max() <= 0.016
    assert judged.prediction.stops == 0
    assert judged.prediction.takeups >= 40
    drawn = [move for move in judged.given if move.start[2] == move.end[2] == 0.2][3:]
    assert all(move.draws for move in drawn)
    ways = np.array([np.subtract(move.end, move.start)[:2] for move in drawn])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    back = np.flatnonzero((ways[:-1] * ways[1:]).sum(axis=1) < -0.5)  # the corners at which the command turns back
    assert len(back) == 23
    assert np.median((ways[back + 1] * ways[back + 2]).sum(axis=1)) > 0.99


@pytest.mark.parametrize("mechanism", [PLAY, COREXY_PLAY], ids=["play", "corexy"])
@pytest.mark.parametrize("at", [(60.0, 60.0), (219.0, 1.0), (0.0, 220.0)])
def test_a_prime_on_the_spot_is_where_it_should_be(mechanism, at: tuple[float, float]) -> None:
    """Nothing is known of where a file without G28 begins: its first travel ends with both belts engaged."""
    text = b"G21\nG90\nM83\nG1 X%g Y%g Z.2 F6000\nG1 E4 F300\nG1 X61 Y61 E.1 F1800\nG1 X80 Y70 E1\n" % at
    written = mended(text, mechanism)[0]
    ends = []
    for begin in ((0.0, 0.0, 0.0), (200.0, 200.0, 0.0)):
        given = naive_mend.read_moves(written, begin)
        prime = next(i for i, move in enumerate(given) if move.filament == 4.0)
        ends.append(naive_mend.print_moves(given, mechanism)[prime][-1])
    assert ends[0] == pytest.approx(ends[1], abs=0.002)  # wherever the head was, 0 being no place like another
    assert ends[0] == pytest.approx(at, abs=0.002 if min(at) > 0.0 else 0.71)  # its play keeps it from the edge


@pytest.mark.parametrize("tolerance_mm", [0.004, 0.03])
def test_the_tolerance_holds(tolerance_mm: float) -> None:
    text = wall(12.0, 300) + b"G1 X30 Y40 E5\nG1 X150 Y60 E5\n"
    judged = judge(text, BENT, tolerance_mm=tolerance_mm)
    assert judged.after.max() <= tolerance_mm + 0.001
    assert judged.after.max() - 0.001 <= judged.prediction.after.max_mm <= tolerance_mm + 0.001


def check_turns(points: np.ndarray, mechanism, slack: tuple[float, float]) -> None:
    """Hold the turns of both motors on a path from (100, 100) against the slow twin's."""
    from tests.naive_turns import agreed, joined, turns

    points = np.concatenate([[[100.0, 100.0]], np.round(points, 3)])
    rows = "".join(f"G1 X{x:.3f} Y{y:.3f} E.02 F1800\n" for x, y in points[1:])
    text = START + b"G0 X100 Y100 F6000\n" + rows.encode()
    planner = start(mechanism)
    planner.plan(interpret_text(np.frombuffer(text, np.uint8), initial_state(ENDER3, Flavour.KLIPPER)))
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    both = [turns(s, points[:, k], points[:, 1 - k], slack[k]) for k in range(2)]
    settled = [agreed(k, both, s, points, slack) for k in range(2)]
    for motor in range(2):
        found = planner._run.turns[motor]
        found = found[: int(np.argmax(np.isinf(found["begin"])))]
        way = settled[motor], settled[1 - motor], s, points[:, motor], points[:, 1 - motor]
        wanted = [turn[:3] for turn in joined(*way)]
        kernel = np.stack([found[name][-len(wanted) :] for name in ("begin", "end", "trend")], axis=1)
        assert len(wanted) > 5
        assert 0 <= len(found) - len(wanted) <= 1  # one more where the belt lay loose
        assert kernel == pytest.approx(np.array(wanted), abs=1e-3)


@MODELS
def test_turns_against_the_slow_twin(mechanism) -> None:
    rng = np.random.default_rng(5)
    steps = rng.uniform(0.2, 1.5, 120)[:, None] * np.stack(
        [f(np.cumsum(rng.normal(0, 0.35, 120))) for f in (np.cos, np.sin)], 1
    )
    steps[rng.random(120) < 0.1, 0] = 0.0  # stretches on which an axis stands still
    check_turns(100 + np.cumsum(steps, axis=0), mechanism, (0.4, 0.7 if mechanism is PLAY else 0.6))


@pytest.mark.parametrize("slack", [(0.1, 0.16), (0.2, 0.3)])
def test_corners_at_which_the_whole_path_goes_back_against_the_slow_twin(slack: tuple[float, float]) -> None:
    rng = np.random.default_rng(6)
    back = np.cumsum(rng.normal(2.8, 0.25, 150))
    steps = rng.uniform(0.2, 4.0, 150)[:, None] * np.stack([np.cos(back), np.sin(back)], 1)
    mechanism = Corruption(tuple(Drive(belt=Play(mm)) for mm in slack)).lower(ENDER3).homed()
    check_turns(100 + np.cumsum(steps, axis=0), mechanism, slack)


@MODELS
def test_travels_are_followed_as_the_slow_twin_follows_them(mechanism) -> None:
    from tests.naive_travel import motors

    rng = np.random.default_rng(7)
    text, legs, at = START, [], np.array([60.0, 60.0])
    for count in rng.integers(2, 7, 40):
        drawn, *ways = at + np.cumsum(np.round(rng.uniform(-4, 4, (count + 1, 2)), 3), axis=0)
        ways = ways if rng.random() < 0.7 else [*ways, ways[-1] + [0.0, 0.25]]
        text += b"G1 X%.3f Y%.3f E.1 F1800\n" % tuple(drawn)
        text += b"".join(b"G0 X%.3f Y%.3f F7200\n" % tuple(way) for way in ways)
        legs.append((drawn, ways))
        at = np.clip(ways[-1], 30, 90)
    text += b"G1 X%.3f Y%.3f E.1 F1800\n" % tuple(at)
    result = judge(text, mechanism)
    right(result)
    given = {}
    for move in result.given:  # take-ups stand behind the travel, whose lines all stay
        given.setdefault(move.line, move.end)
    lines = [line for line in result.text.splitlines() if line.startswith(b"G0")][1:]
    assert len(lines) == sum(len(ways) for _, ways in legs)
    firsts = [number for number, line in enumerate(result.text.splitlines()) if line.startswith(b"G0")][1:]
    planned = 0
    for number, (drawn, ways) in enumerate(legs):
        after = legs[number + 1][0] if number + 1 < len(legs) else at
        numbers, firsts = firsts[: len(ways)], firsts[len(ways) :]
        places, lengths = np.array([drawn, *ways]), np.linalg.norm(np.diff([drawn, *ways], axis=0), axis=1)
        for k, drive in enumerate(mechanism.transmissions):
            wanted = motors(places[:, k], lengths, given[numbers[0] - 1][k], after[k], drive)
            planned += wanted[-1] is not None
            for line, to in zip(numbers, wanted, strict=True):
                assert to is None or given[line][k] == pytest.approx(to, abs=0.0025)
    assert planned > 60


def test_a_travel_crosses_its_slack_once() -> None:
    legs = [(82, 61), (84, 60), (86, 61), (88, 60), (90, 61), (92, 60), (90, 62)]
    text = START + b"G1 X80 Y60 E1 F1800\n" + b"".join(b"G0 X%d Y%d F6000\n" % leg for leg in legs)
    result = judge(text + b"G1 X70 Y62 E1 F1800\n", PLAY)
    right(result)
    travelled = [
        sum(math.dist(m.start, m.end) for m in moves if not m.draws) for moves in (result.wanted, result.given)
    ]
    # each of its six turns in y would cost 0.7 mm
    assert travelled[1] - travelled[0] < 0.4 + 0.7


def test_a_motor_with_nothing_to_do_on_a_travel_crosses_its_slack_there() -> None:
    """Y travels alone, and X has to turn back: one command does both, and the line behind it needs none of its own."""
    judged = judge(START + b"G1 X80 Y60 E1 F1800\nG1 X70 E1\nG0 Y70 F6000\nG1 X80 E1 F1800\n", PLAY)
    travel, line = judged.text.splitlines()[-2:]
    assert b"X70.4 " in travel
    assert line.startswith(b"G1 X80.4 E1")
    assert judged.rms_mm < 0.006


def test_a_slow_firmware_gets_fewer_moves() -> None:
    """120 mm/s and 100 moves a second: no piece of a line is shorter than 1.2 mm, but for the gain."""
    from printmend.gcode.write import rewrite
    from printmend.plan.inverse import Fineness, start

    text = START + b"G1 X150 Y110 E5 F7200\n"
    for firmware in (None, "marlin8"):
        planner, state = start(BENT, tolerance_mm=0.0004), initial_state(ENDER3, Flavour.KLIPPER)
        planner.begin(Fineness(firmware=firmware).segments_per_s(Flavour.KLIPPER))
        given = b"".join(bytes(view) for view in rewrite([np.frombuffer(text, np.uint8)], state, planner.plan))
        lengths = [move.length for move in naive_mend.read_moves(given, (0.0, 0.0, 0.0)) if move.draws]
        assert min(lengths) > (1.1 if firmware else 0.0)
        assert firmware or min(lengths) < 0.9


@MODELS
def test_a_purge_line_at_the_beds_edge_stays_a_line(mechanism) -> None:
    """Where the edge holds a move back no number of pieces would bring it nearer."""
    text = START + b"G0 X0.1 Y20 F6000\nG1 Y200 E15 F1500\nG0 X0.4\nG1 Y20 E15\nG0 X60 Y60\nG1 X80 E1 F1800\n"
    judged = judge(text, mechanism)
    assert sum(move.draws for move in judged.given) < (60 if mechanism is BENT else 8)
    assert min(move.end[0] for move in judged.given) >= 0


def test_a_mended_vase_is_judged_like_a_flat_wall(tmp_path: Path) -> None:
    """Without layer comments its pieces have heights of their own: filament says what they belong to."""
    from printmend.errors import GcodeError
    from printmend.mend import mend_gcode
    from printmend.mend.against import judged as judged_against
    from tests.mending import exactly

    found = {}
    for rise in (0.0, 0.2):
        source, output = tmp_path / f"{rise}.gcode", tmp_path / f"{rise}.out.gcode"
        t = np.linspace(0, 6 * np.pi, 240)[1:]
        rows = (f"X{70 + 10 * math.cos(a):.3f} Y{70 + 10 * math.sin(a):.3f} Z{0.2 + rise * a / 6.2832:.3f}" for a in t)
        lines = "".join(f"G1 {row} E0.03\n" for row in rows)
        source.write_bytes(START + b"G0 X80 Y70\nG1 F1500\n" + lines.encode())
        done = mend_gcode(source, exactly(BENT), output)
        found[rise] = judged_against(done.prediction, str(source), str(output), BENT)
    assert max(each.after.max_mm for each in found.values()) < 0.012
    assert found[0.2].before.rms_mm == pytest.approx(found[0.0].before.rms_mm, rel=0.02)
    short = tmp_path / "short.gcode"
    short.write_bytes(b"\n".join((tmp_path / "0.2.out.gcode").read_bytes().splitlines()[:150]) + b"\n")
    with pytest.raises(GcodeError, match=r"expected the .* mm of filament"):
        judged_against(done.prediction, str(tmp_path / "0.2.gcode"), str(short), BENT)


def test_the_end_of_a_travel_is_seen_as_the_slow_version_sees_it() -> None:
    from tests.naive_travel import arrival

    rng = np.random.default_rng(4)
    kinds = {
        "G0 X{x:.3f} Y{y:.3f}": 30, "G0 Z{z:.3f}": 12, "G1 X{x:.3f} Z{z:.3f}": 4, "G1 E-0.4": 4, "G1 E0.4": 4,
        "G1 X{x:.3f} Y{y:.3f} E0.1": 12, "G0 X{far:.3f}": 2, "G3 X{x:.3f} Y{y:.3f} R300": 2, "T0": 1,
    }  # fmt: skip
    names, weights = list(kinds), np.array(list(kinds.values()), float)
    chosen = [names[k] for k in rng.choice(len(names), 1500, p=weights / weights.sum())]
    chosen += ["G0 X{x:.3f} Y{y:.3f}"] * 300 + ["G1 X{x:.3f} Y{y:.3f} E0.1"]  # looked for in 256 records only
    draw = rng.uniform
    lines = [name.format(x=draw(1, 200), y=draw(1, 200), z=draw(0, 20), far=draw(430, 900)) for name in chosen]
    text = START.decode() + "\n".join(lines) + "\n"
    records = interpret_text(np.frombuffer(text.encode(), np.uint8), initial_state(ENDER3, Flavour.KLIPPER))
    moves = {}
    for move in naive_mend.read_moves(text, (0.0, 0.0, 0.0)):
        moves[move.line] = None if move.homing or move.line in moves else move
    arcs = {number for number, line in enumerate(text.splitlines()) if line.startswith("G3")}
    rows = [None if line in arcs else moves.get(line) for line in records["line"]]
    model, found = lookup(PLAY), []
    fields = [SimpleNamespace(**dict(zip(records.dtype.names, row, strict=True))) for row in records.tolist()]
    for i in range(len(records)):
        found.append(arrival(rows[i:], (-220.0, 440.0)))
        assert kernels.arrival(model, fields, len(records), i) == pytest.approx(found[-1])
    assert {each[:2] for each in found} == {(False, False), (True, False), (True, True)}
    assert {each[3] for each in found} == {-1.0, 0.0, 1.0}


@MODELS
def test_a_line_from_nobody_knows_where_is_as_far_off_as_the_slow_version_says(mechanism) -> None:
    from tests.naive_travel import from_home_mm

    model, rng = lookup(mechanism), np.random.default_rng(8)
    line = record(RECORD)
    for x, y in rng.uniform(5, 215, (25, 2)):
        line.x1, line.y1 = x, y
        motor = np.asarray(mechanism.printer.to_motor(np.array([x, y]) + rng.uniform(-1, 1, 2)), float)
        found = mend_kernels._from_home(model, line, *motor)
        assert found == pytest.approx(from_home_mm(mechanism, np.array([x, y]), motor), abs=2e-3)
        assert found > 0.05


def test_a_path_goes_on_behind_a_feed_alone() -> None:
    """Its slack is crossed as if the feed stood on the line behind it."""
    lines = [b"G1 X%.1f Y%.1f E.2 F1800\n" % (60 + 4 * i, 60 + abs(4 - i)) for i in range(9)]
    whole, _ = mended(START + b"".join(lines), PLAY)
    parted, prediction = mended(START + b"G1 F1800\n".join(lines), PLAY)
    assert parted.replace(b"G1 F1800\n", b"") == whole
    assert prediction.stops == 0
