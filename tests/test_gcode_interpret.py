"""The compiled interpreter against the slow one, and numbers against float()."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.gcode import kernels as k
from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.read import interpret_text
from tests import naive_gcode

KINDS = {"linear": k.KIND_LINEAR, "cw": k.KIND_CW, "ccw": k.KIND_CCW, "home": k.KIND_HOME, "set": k.KIND_SET}
RULES = {Flavour.UNKNOWN: ("either", True), Flavour.MARLIN2: ("follows", False), Flavour.RRF: ("apart", False)}


def records_of(text: str | bytes, flavour: Flavour = Flavour.UNKNOWN) -> np.ndarray:
    data = text.encode() if isinstance(text, str) else text
    return interpret_text(np.frombuffer(data, np.uint8), initial_state(flavour=flavour))


def number_of(text: str) -> float:
    return float(records_of(f"G1 X{text}\n")["x1"][0])


numbers = st.builds(
    lambda sign, whole, part: f"{sign}{whole}.{part}" if whole or part else f"{sign}0",
    st.sampled_from(["", "-", "+"]),
    st.text("0123456789", max_size=9),
    st.text("0123456789", max_size=9),
)


@given(numbers)
@settings(deadline=None)
def test_numbers_read_as_float_reads_them(text):
    wanted = float(text)
    assert number_of(text) == wanted


@given(st.text("0123456789", min_size=10, max_size=17), st.integers(0, 17))
@settings(max_examples=300, deadline=None)
def test_numbers_of_18_digits_are_rounded_correctly(digits, point):
    text = f"{digits[:point]}.{digits[point:]}"
    wanted = float(text)
    assert number_of(text) == min(wanted, 1e15)


@given(st.floats(-1e6, 1e6))
@settings(deadline=None)
def test_shortest_representation_round_trips(value):
    text = f"{value:.17f}"
    if len(text.replace(".", "").strip("-0")) <= 18:
        assert number_of(text) == float(text)


@pytest.mark.parametrize(
    ("line", "x", "e"),
    [
        ("G1 X1e-4 Y5", 1e-4, 0.0),  # a slicer's float, not X1 and E-4
        ("G1 X2.4492935982947065e-15 Y5", 2.4492935982947065e-15, 0.0),
        ("G1 X1.0E-4 Y5", 1e-4, 0.0),
        ("G1X1E-4", 1.0, -4.0),  # without blanks an E is an E word
        ("g1x1e4", 1.0, 4.0),
        ("G1 X1 E-4", 1.0, -4.0),
        ("G1 X1E5", 1.0, 5.0),
        ("G1 X.5", 0.5, 0.0),
        ("G1 X-.5", -0.5, 0.0),
        ("G1 X+5.", 5.0, 0.0),
        ("G1 X 7", 7.0, 0.0),
        ("G1 X0000000000000000000012.50", 12.5, 0.0),
        ("G1 X1.00000000000000000000000000001", 1.0, 0.0),
        ("G1 X" + "9" * 400, 1e15, 0.0),
    ],
)
def test_numbers_with_exponents_and_odd_forms(line, x, e):
    record = records_of(line)[0]
    assert record["x1"] == x
    assert record["e1"] == e


coordinate = st.builds(lambda v: f"{v / 1000:.3f}".rstrip("0").rstrip("."), st.integers(-99999, 99999))


def words(letters, least=0):
    chosen = st.lists(st.sampled_from(letters), min_size=least, max_size=len(letters), unique=True)
    return chosen.flatmap(lambda names: st.tuples(*[coordinate.map(lambda v, n=n: n + v) for n in names]))


def joined(command, letters, least=0):
    separator = st.sampled_from([" ", ""])
    return st.builds(lambda sep, parts: sep.join([command, *parts]), separator, words(letters, least))


SINGLE = (
    "G90",
    "G91",
    "M82",
    "M83",
    "G20",
    "G21",
    "G17",
    "G18",
    "G19",
    "G28",
    "G28 X",
    "G28 X Y",
    "G28Z0",
    "G54",
    "G55",
    "M221 S90",
    "M104 S200",
    "G4 P10",
    "M117 G1 X99 Y99",
    "M73 P10 R5 G1 X99 Y99",
    "O1 X9 Y9",
    "W1 E3",
    "",
    "; G1 X50",
    "(G1 X50)",
    "SAVE_GCODE_STATE NAME=a",
    "RESTORE_GCODE_STATE NAME=a",
    "RESTORE_GCODE_STATE NAME=a MOVE=1",
    "SET_GCODE_OFFSET X=1.5 Y_ADJUST=-2",
    "SET_GCODE_OFFSET Z=0.2 MOVE=1",
    "SET_PRESSURE_ADVANCE A=1",
    "G90.1",
    "G91.1",
)

statement = st.one_of(
    joined("G1", "XYZEF"),
    joined("G0", "XYZF"),
    joined("g1", "xyze"),
    joined("G01", "XYE"),
    joined("G2", "XYEI", 1),
    joined("G3", "XYIJK", 1),
    joined("G2", "XYR", 2),
    joined("G92", "XYZE"),
    st.sampled_from(SINGLE),
    st.builds(lambda mode, move: f"{mode} {move}", st.sampled_from(["G90", "G91", "G53"]), joined("G1", "XYZ", 1)),
    st.builds(lambda parts: " ".join(parts), words("XYE", 1)),  # no G word: the last motion again
    st.builds(lambda n, move: f"N{n} {move} *12", st.integers(0, 999), joined("G1", "XYE", 1)),
    st.builds(lambda move: f"  {move} ; comment G1 X1", joined("G1", "XYE")),
)


@given(st.lists(statement, max_size=25), st.sampled_from(sorted(RULES)), st.sampled_from(["\n", "\r\n"]))
@settings(max_examples=150, deadline=None)
def test_the_kernel_agrees_with_the_slow_interpreter(lines, flavour, eol):
    # A file saved nothing under that name: what RESTORE does then is not defined.
    text = eol.join(["SAVE_GCODE_STATE NAME=a", *lines])
    rule, zeroes = RULES[flavour]
    wanted = list(naive_gcode.NaiveMachine(rule=rule, bare_g92_zeroes=zeroes).run(text))
    records = records_of(text, flavour)
    got = records[(records["kind"] != k.KIND_EVENT) | (records["event"] == k.EVENT_UNKNOWN)]
    assert list(got["line"]) == [event["line"] for event in wanted]
    for event, record in zip(wanted, got, strict=True):
        assert record["kind"] == KINDS.get(event["kind"], k.KIND_EVENT)
        assert (record["x1"], record["y1"], record["z1"]) == pytest.approx(event["place"], abs=1e-9)
        assert (record["e1"], record["feed"]) == pytest.approx((event["e"], event["feed"]), abs=1e-9)
        assert record["advance"] == pytest.approx(event["advance"], abs=1e-9)
        assert tuple(record["flags"] >> (7 + a) & 1 for a in range(3)) == tuple(map(int, event["known"]))
        if event["centre"] is not None:
            assert (record["c0"], record["c1"]) == pytest.approx(event["centre"], abs=1e-4)
        elif event["kind"] == "linear":
            assert math.isnan(record["c0"])


@given(st.binary(max_size=400))
@settings(max_examples=200, deadline=None)
def test_any_bytes_end_in_records_within_the_text(data):
    records = records_of(data)
    assert ((records["begin"] >= 0) & (records["begin"] <= records["end"])).all()
    assert ((records["end"] <= records["next"]) & (records["next"] <= len(data))).all()
    assert (records["begin"][1:] >= records["end"][:-1]).all()
    for name in ("x1", "y1", "z1", "e1", "feed", "advance"):
        assert np.isfinite(records[name]).all()


@given(st.lists(statement, min_size=1, max_size=30), st.integers(4, 40))
@settings(max_examples=100, deadline=None)
def test_a_file_in_pieces_reads_as_the_whole(lines, cut):
    text = ("\n".join(lines) + "\n").encode()
    whole = records_of(text)
    state = initial_state()
    parts, start = [], 0
    while start < len(text):
        stop = text.find(b"\n", min(start + cut, len(text) - 1)) + 1
        piece = interpret_text(np.frombuffer(text[start:stop], np.uint8), state)
        for name in ("begin", "end", "next"):
            piece[name] += start
        parts.append(piece)
        start = stop
    pieces = np.concatenate(parts)
    for name in k.RECORD.names:
        np.testing.assert_array_equal(pieces[name], whole[name])


def test_records_are_filled_only_as_far_as_they_fit():
    text = b"X1\n" * 100
    state = initial_state()
    buffer, records = np.frombuffer(text, np.uint8), np.empty(10, k.RECORD)
    count, after = k.interpret(buffer, 0, len(buffer), state.numbers, state.counts, records, k.NO_NOTES)
    assert 0 < count <= 10
    assert after == 3 * count


@given(
    st.lists(joined("G1", "XYZEF"), max_size=20),
    st.sampled_from(["G90\nM82", "G91", "M83", "G92 X3 E1", "M221 S80", "G20"]),
)
@settings(deadline=None)
def test_the_short_way_does_what_the_general_way_does(lines, mode):
    # A blank before the command sends a line the general way.
    short, general = (
        records_of("\n".join(["G28 X Y", mode, *(blank + line + " ; c" for line in lines)])) for blank in ("", " ")
    )
    for name in set(k.RECORD.names) - {"begin", "end", "next", "flags"}:
        np.testing.assert_array_equal(short[name], general[name])
    np.testing.assert_array_equal(
        short["flags"] & ~np.uint32(k.FLAG_PLAIN | k.FLAG_SPACED), general["flags"] & ~np.uint32(k.FLAG_SPACED)
    )


def test_a_curve_is_cut_into_chords_that_stay_near_it() -> None:
    """Their ends lie on Marlin's curve, E and height go with its parameter, and a chord is off by 5 µm at the most."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        start, end, first, second = np.round(rng.uniform(-60, 60, (4, 2)), 3)
        records = records_of(
            f"G28\nG1 X{start[0]} Y{start[1]}\nG5 X{end[0]} Y{end[1]} Z1 E5 I{first[0]} J{first[1]} "
            f"P{second[0]} Q{second[1]} F900 ; G5\nG5 X0 Y0 I1 J1\n"
        )
        chords, last = records[2:-1], records[-1]
        assert (chords["kind"] == k.KIND_LINEAR).all()
        assert (last["kind"], last["event"]) == (k.KIND_EVENT, k.EVENT_SPLINE)
        n = len(chords)
        share = np.arange(n + 1) / n
        assert chords["e1"] == pytest.approx(5 * share[1:])
        assert chords["z0"] == pytest.approx(share[:-1])
        assert set(chords["feed"]) == {900.0}
        assert (chords["begin"][:-1] == chords["end"][:-1]).all()
        t = (share[:-1, None] + np.linspace(0, 1, 21) / n)[..., None]  # [n, 21, 1]
        control = [start, start + first, end + second, end]
        weights = [(1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3]
        curve = sum(w * c for w, c in zip(weights, control, strict=True))
        chord = np.stack([chords["x1"] - chords["x0"], chords["y1"] - chords["y0"]], axis=1)
        assert np.stack([chords["x0"], chords["y0"]], axis=1) == pytest.approx(curve[:, 0], abs=1e-9)
        along = np.linalg.norm(chord, axis=1)[:, None]
        from_start = curve - curve[:, :1]
        off = np.abs(from_start[..., 0] * chord[:, None, 1] - from_start[..., 1] * chord[:, None, 0]) / along
        assert off.max() <= 0.005 + 1e-9
        assert n < 3 or off.max() > 0.001


def test_a_straight_curve_is_one_line_and_one_that_stands_is_left() -> None:
    straight, still = records_of("G28\nG1 X0 Y0\nG5 X30 Y0 I10 J0 P-10 Q0 E1\nG5 X30 Y0 I0 J0 P0 Q0\n")[-2:]
    assert (straight["kind"], straight["x0"], straight["x1"]) == (k.KIND_LINEAR, 0.0, 30.0)
    assert straight["end"] > straight["begin"]
    assert still["event"] == k.EVENT_SPLINE


@pytest.mark.parametrize("line", [
    "G4.96 X30 Y0 I3 J9 P-3 Q9", "g+005.04 X30 Y0 I3 J9 P-3 Q9", "G1 X1 (;) G5 X30 Y0 I3 J9 P-3 Q9",
    'M104 S1 "(;" G5 X30 Y0 I3 J9 P-3 Q9', "(;)" + "G1X1" * 300, "G5 X30 Y0 I3 J9 P-3 Q9 " * 9,
])  # fmt: skip
def test_no_line_writes_more_records_than_there_is_room_for(line: str) -> None:
    """However its commands are written: what does not fit is left for the next call, with more room."""
    text, state = np.frombuffer(f"G28\nG1 X0 Y0\n{line}\n".encode(), np.uint8), initial_state()
    room, beyond = 40, 10_000
    memory = np.zeros(room + beyond, k.RECORD)
    count, stopped = k.interpret(text, 0, len(text), state.numbers, state.counts, memory[:room], k.NO_NOTES)
    assert not memory[room:].tobytes().strip(b"\0")
    assert count <= room
    assert stopped < len(text)
    assert len(records_of(text.tobytes())) > room
