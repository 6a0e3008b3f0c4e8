"""Rewriting: what is not asked for stays byte for byte, and what is written moves the machine where it was asked to."""

import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from printmend.gcode import kernels as k
from printmend.gcode.container import open_gcode
from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.read import interpret_text
from printmend.gcode.write import rewrite
from tests.test_gcode_interpret import RULES, statement


def rewritten(text: bytes, plan, flavour: Flavour = Flavour.UNKNOWN, *, cut: int = 1 << 20) -> bytes:
    """Rewrite a text in chunks of whole lines of about ``cut`` bytes."""
    chunks, start = [], 0
    while start < len(text):
        stop = text.find(b"\n", min(start + cut, len(text) - 1)) + 1 or len(text)
        chunks.append(np.frombuffer(text[start:stop], np.uint8))
        start = stop

    def whole(records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
        assert begin == 0
        return len(records), *plan(records)

    return b"".join(bytes(view) for view in rewrite(chunks, initial_state(flavour=flavour), whole))


def keep(records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(len(records) + 1, np.int64), np.empty(0, k.PIECE)


def is_motion(records: np.ndarray) -> np.ndarray:
    motion = np.isin(records["kind"], (k.KIND_LINEAR, k.KIND_CW, k.KIND_CCW))
    return motion & (records["words"] & k.WORDS_XYZ > 0) & (records["flags"] & k.FLAG_OPAQUE == 0)


def repeat(records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ask for every motion once more, as it is."""
    moving = is_motion(records)
    rows, pieces = records[moving], np.zeros(moving.sum(), k.PIECE)
    for name, source in (("x", "x1"), ("y", "y1"), ("z", "z1"), ("c0", "c0"), ("c1", "c1")):
        pieces[name] = rows[source]
    pieces["share"] = 1.0
    pieces["kind"] = np.where(rows["kind"] == k.KIND_LINEAR, k.PIECE_LINE, k.PIECE_ARC)
    return np.concatenate([[0], np.cumsum(moving)]).astype(np.int64), pieces


class Bend:
    """Displace every move and cut it into up to three parts; remember what was asked for."""

    def __init__(self, seed: int = 1, parts: int = 3, feed: bool = False) -> None:
        self.rng, self.parts, self.feed, self.wanted = np.random.default_rng(seed), parts, feed, []

    def __call__(self, records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        known = records["flags"] >> 7 & 3 == 3
        counts = np.where(is_motion(records) & known, self.rng.integers(1, self.parts + 1, len(records)), 0)
        source = np.repeat(np.arange(len(records)), counts)
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        rows, step = records[source], np.arange(len(source)) - first[source] + 1
        part = step / counts[source]
        pieces = np.zeros(len(source), k.PIECE)
        for axis in "xyz":
            along = rows[axis + "0"] + (rows[axis + "1"] - rows[axis + "0"]) * part
            pieces[axis] = np.where(step == counts[source], rows[axis + "1"], along)
        pieces["x"] += 0.5 * np.sin(pieces["y"] / 7)
        pieces["y"] += 0.5 * np.cos(pieces["x"] / 9)
        pieces["share"] = 1.0 / counts[source]
        if self.feed:
            pieces["feed"] = np.round(self.rng.uniform(300, 6000, len(source)))
        self.wanted += [(records[i].copy(), pieces[first[i] : first[i + 1]].copy()) for i in range(len(records))]
        return first, pieces


@pytest.mark.parametrize("plan", [keep, repeat])
def test_every_corpus_file_comes_back_byte_for_byte(corpus, plan):
    seen = 0
    for path in sorted((corpus / "gcode").rglob("*")):
        if not path.is_file() or path.name == "test_bad_crc_gcode.bgcode":
            continue
        with open_gcode(path) as file:
            text = b"".join(bytes(chunk) for chunk in file.parts[0].chunks())
        back = rewritten(text, plan, cut=100_000)
        assert back == text or _same_but_numbers(text, back), path
        seen += 1
    assert seen > 40


def _same_but_numbers(text: bytes, back: bytes) -> bool:
    """A word that comes twice in one statement keeps its first only; nothing else may differ."""
    pairs = zip(text.split(b"\n"), back.split(b"\n"), strict=True)
    return all(a == b or len(set(re.findall(rb"[A-Z]", a))) < len(re.findall(rb"[A-Z]", a)) for a, b in pairs)


@given(st.binary(max_size=300), st.integers(1, 60))
@settings(deadline=None)
def test_any_bytes_come_back(data, cut):
    assert rewritten(data, keep, cut=cut) == data


def place_tolerance(record: np.void) -> float:
    return 6e-4 if not record["flags"] & k.FLAG_INCH else 1.5e-4


@given(st.lists(statement, max_size=25), st.sampled_from(sorted(RULES)), st.integers(0, 99), st.booleans())
@example(["G0 X0 Y0 F0", "G1"], sorted(RULES)[0], 0, True)  # F0 asks for no speed
@settings(max_examples=100, deadline=None)
def test_the_rewritten_file_goes_where_it_was_asked_to(lines, flavour, seed, feed):
    # A layer comment after each line tells which lines of the output belong to it.
    text = "".join(f"{line}\n;LAYER_CHANGE\n" for line in ["G28", "G1 X1 Y2 Z3 F900", *lines]).encode()
    plan = Bend(seed, feed=feed)
    output = rewritten(text, plan, flavour)
    records = interpret_text(np.frombuffer(output, np.uint8), initial_state(flavour=flavour))
    assert not re.search(rb"\d[eE][-+]?\d+[ \n]", b"".join(re.findall(rb"G1 X\S+ Y\S+\n", output)))
    originals = interpret_text(np.frombuffer(text, np.uint8), initial_state(flavour=flavour))
    for original, pieces in plan.wanted:
        group = records[records["layer"] == original["layer"]]
        mates = originals[originals["layer"] == original["layer"]]
        if len(mates) != 1:
            continue  # several statements on one line
        if len(pieces):
            ends = np.column_stack([np.append(group[axis + "0"][:1], group[axis + "1"]) for axis in "xyz"])
            for piece in pieces:
                wanted = np.array([piece["x"], piece["y"], piece["z"]])
                known = [bool(original["flags"] >> (7 + axis) & 1) for axis in range(3)]
                distance = np.abs(ends - wanted)[:, known].max(axis=1).min()
                assert distance <= place_tolerance(original)
            last = np.abs(ends[-1] - np.array([pieces[-1][axis] for axis in "xyz"]))[known]
            assert last.max() <= place_tolerance(original)
        # Absolute E is where it was; relative parts sum to the whole.
        assert group["advance"].sum() == pytest.approx(original["advance"], abs=3e-4 * max(1, len(group)))
        if original["kind"] in (k.KIND_LINEAR, k.KIND_CW, k.KIND_CCW):
            wanted_feed = pieces[-1]["feed"] if len(pieces) and feed else original["feed"]
            assert group["feed"][-1] == pytest.approx(wanted_feed, abs=0.02)


def test_extrusion_adds_up_over_a_layer_of_long_numbers():
    rng = np.random.default_rng(5)
    lines = [f"G1 X{x:.3f} Y{y:.3f} E{e:.9f}" for x, y, e in rng.uniform(0, 1, (3000, 3)) * [100, 100, 0.1]]
    text = ("M83\nG28\n" + "\n".join(lines) + "\n").encode()
    output = rewritten(text, Bend(2))
    before, after = (interpret_text(np.frombuffer(t, np.uint8), initial_state()) for t in (text, output))
    assert after["advance"].sum() == pytest.approx(before["advance"].sum(), abs=1e-5)
    assert len(after) > 1.5 * len(before)


def test_relative_moves_do_not_drift():
    lines = "".join(f"G1 X{(-1) ** i * 1.0001:.4f} Y0.0003\n" for i in range(2000))
    text = ("G28\nG1 X50 Y50 F600\nG91\n" + lines).encode()
    plan = Bend(3)
    output = rewritten(text, plan)
    last = interpret_text(np.frombuffer(output, np.uint8), initial_state())[-1]
    assert last["x1"] == pytest.approx(plan.wanted[-1][1][-1]["x"], abs=6e-4)
    assert last["y1"] == pytest.approx(plan.wanted[-1][1][-1]["y"], abs=6e-4)


def pieces_for(*ends: tuple, kind: int = k.PIECE_LINE, feed: float = 0.0) -> np.ndarray:
    pieces = np.zeros(len(ends), k.PIECE)
    for piece, end in zip(pieces, ends, strict=True):
        piece["x"], piece["y"], piece["z"] = end
    pieces["share"], pieces["kind"], pieces["feed"] = 1 / len(ends), kind, feed
    return pieces


def replace_last(pieces: np.ndarray):
    """A plan that replaces the last motion of a text."""

    def plan(records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        target = np.flatnonzero(is_motion(records))[-1]
        return np.where(np.arange(len(records) + 1) > target, len(pieces), 0).astype(np.int64), pieces

    return plan


@pytest.mark.parametrize(
    ("line", "ends", "wanted"),
    [
        ("G1 X10 Y5 E2 ; wall", [(10.5, 5.25, 0)], "G1 X10.5 Y5.25 E2 ; wall"),
        ("G1 Y5", [(0.25, 5, 0)], "G1 Y5 X0.25"),  # the axis that the move does not name
        ("G1 X10 E2", [(4, 0, 0), (10, 0.1234, 0)], "G1 X4 E1\nG1 X10 Y0.123 E2"),
        ("M83\nG1 X10 E3", [(4, 0, 0), (10, 0, 0)], "M83\nG1 X4 E1.5\nG1 X10 E1.5"),
        ("g1x10y5e2;c", [(9.99, 5, 0)], "g1x9.99y5e2;c"),
        ("G1 Y5 X10 F600 S3", [(1, 1, 0), (2, 2, 0)], "G1 X1 Y1 F600 S3\nG1 Y2 X2 F600 S3"),
        ("G01 X.5 Z1", [(0.6, 0, 1)], "G01 X0.6 Z1"),
        ("G91\nG1 X5", [(4.5, 0.2, 0)], "G91\nG1 X4.5 Y0.2"),
        ("G20\nG1 X1", [(50.8, 0, 0)], "G20\nG1 X2"),
        ("G1 X7 Y7\nX10", [(9.5, 7, 0)], "G1 X7 Y7\nX9.5"),
        ("G21 G90 G1 X10", [(5, 5, 0), (9, 9, 0)], "G21 G90 G1 X5 Y5\nG1 X9 Y9"),
        ("G1 X10 (in) Y5", [(9, 4, 0)], "G1 X9 (in) Y4"),
        ("G2 X10 Y0 I5 J0 E4", [(5, 5, 0), (10, 0, 0)], "G1 X5 Y5 E2\nG1 X10 Y0 E4"),
        ("G3 X10 R5", [(10, 1, 0)], "G1 X10 Y1"),
        ("G92 X100\nG1 X110", [(10.5, 0, 0)], "G92 X100\nG1 X110.5"),
        ("G1 X10 Y10 F5e-1", [(9, 9, 0)], "G1 X9 Y9 F5e-1"),
        ("G1 X1e-4 Y10", [(9, 9, 0)], "G1 X9 Y9"),
    ],
)
def test_statements_keep_their_style(line, ends, wanted):
    assert rewritten(line.encode(), replace_last(pieces_for(*ends))).decode() == wanted


def test_an_arc_can_stay_an_arc():
    pieces = pieces_for((10.5, 0.25, 0), kind=k.PIECE_ARC)
    pieces["c0"], pieces["c1"] = 5.25, 0.125
    assert rewritten(b"G2 X10 Y0 I5 J0 E4", replace_last(pieces)) == b"G2 X10.5 Y0.25 I5.25 J0.125 E4"
    assert rewritten(b"G2 X10 Y0 R5", replace_last(pieces)) == b"G2 X10.5 Y0.25 I5.25 J0.125"


def test_a_take_up_move_extrudes_nothing():
    pieces = pieces_for((0.3, 0, 0), (10.3, 0, 0))
    pieces["kind"], pieces["share"] = [k.PIECE_TRAVEL, k.PIECE_LINE], [0.0, 1.0]
    pieces["feed"] = [6000.0, 0.0]
    output = rewritten(b"M83\nG1 F1200\nG1 X10 E1\n", replace_last(pieces))
    assert output == b"M83\nG1 F1200\nG1 X0.3 F6000\nG1 X10.3 E1 F1200\n"


def test_a_feed_that_later_lines_rely_on_is_said_again():
    text = b"G1 F1200\nG1 X10\nG1 E-1\nG1 E1 F300\n"
    output = rewritten(text, replace_last(pieces_for((10, 0, 0), feed=700)))
    assert output == b"G1 F1200\nG1 X10 F700\nG1 F1200\nG1 E-1\nG1 E1 F300\n"


def test_a_mended_place_carries_over_a_new_zero():
    text = b"G28\nG1 X10 Y10\nG92 X0\nG1 X5\nG1 Y3\n"
    ends = iter([(10.4, 10.0), (15.2, 10.0), (15.2, 3.0)])

    def plan(records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moving = is_motion(records)
        pieces = pieces_for(*[(*next(ends), 0.0) for _ in range(moving.sum())])
        pieces["share"] = 1
        return np.concatenate([[0], np.cumsum(moving)]).astype(np.int64), pieces

    output = rewritten(text, plan)
    records = interpret_text(np.frombuffer(output, np.uint8), initial_state())
    assert list(records["x1"]) == pytest.approx([0, 10.4, 10.4, 15.2, 15.2])
    assert output == b"G28\nG1 X10.4 Y10\nG92 X0\nG1 X4.8\nG1 Y3\n"


@pytest.mark.parametrize("eol", ["\n", "\r\n", "\r\r\n"])
def test_every_line_has_its_own_end(eol):
    text = f"G28{eol}G1 X10{eol}G1 X20".encode()
    output = rewritten(text, replace_last(pieces_for((15, 0, 0), (20, 1, 0))))
    end = "\r\n" if "\r" in eol else "\n"  # the last line has none of its own to copy
    assert output.decode() == f"G28{eol}G1 X10{eol}G1 X15{end}G1 X20 Y1"
    assert rewritten(text, keep) == text
    curve = f"G28{eol}M83{eol}G1 X9 Y9{eol}G5 X30 I3 J9 P-3 Q9 E1{eol}X20{eol}G91{eol}G5 X3 I3 J9 P-3 Q9 E1".encode()
    assert rewritten(curve, keep) == curve


def test_a_long_end_of_a_line_is_not_written_again():
    end = "\r" * 9 + "\n"
    output = rewritten(f"G28{end}G1 X20{end}".encode(), replace_last(pieces_for((10, 0, 0), (20, 0, 0))))
    assert output.decode() == f"G28{end}G1 X10\r\nG1 X20{end}"


def checked(line: str) -> str:
    total = 0
    for byte in line.encode():
        total ^= byte
    return f"{line}*{total}"


def test_line_numbers_and_checksums_follow_new_lines():
    hot = " ; hot"
    text = "\n".join([checked("N1 G28"), checked("N2 G1 X10"), checked("N3 M104 S200") + hot, checked("N4 M110 N0"),
                      checked("N1 M105"), ""])  # fmt: skip
    output = rewritten(text.encode(), replace_last(pieces_for((4, 0, 0), (10, 1, 0)))).decode()
    wanted = [checked("N1 G28"), checked("N2 G1 X4"), checked("N3 G1 X10 Y1"), checked("N4 M104 S200") + hot,
              checked("N4 M110 N0"), checked("N1 M105"), ""]  # fmt: skip
    assert output.split("\n") == wanted
    assert rewritten(text.encode(), keep) == text.encode()


def test_a_wrong_checksum_of_an_untouched_line_is_not_ours_to_mend():
    text = b"N1 G1 X5*1\nN2 G1 X6*2\n"
    assert rewritten(text, keep) == text
    assert rewritten(text, repeat) == text


def test_generated_lines_are_short_and_plain():
    rng = np.random.default_rng(3)
    lines = [f"G1 X{x:.9f} Y{y:.9f} Z{z:.9f} E{e:.9f} F{f:.9f}" for x, y, z, e, f in rng.uniform(100, 999, (200, 5))]
    output = rewritten("\n".join(["G28", *lines]).encode(), Bend(1, feed=True))
    generated = set(output.split(b"\n")) - {line.encode() for line in lines}
    assert max(map(len, generated)) < 96
    assert not any(re.search(rb"\d[eE]", line) for line in generated)


def test_a_place_nobody_knows_is_not_written_down():
    text = b"G28\nG1 X5 Y5 Z1\nSOME_MACRO\nG1 X10\n"
    output = rewritten(text, replace_last(pieces_for((10.5, 5.5, 1.0))))
    assert output == b"G28\nG1 X5 Y5 Z1\nSOME_MACRO\nG1 X10.5\n"


def test_long_lines_and_many_pieces_outgrow_the_buffers():
    text = b"G28\nG1 X1 ;" + b"c" * 300_000 + b"\n" + b"G1 X1" * 40_000 + b"\nG1 X5\n"
    assert rewritten(text, keep) == text
    many = pieces_for(*[(i * 1e-3 + 1, (i % 2) * 1e-2, 0) for i in range(60_000)])
    output = rewritten(text, replace_last(many))
    assert output.count(b"\n") >= text.count(b"\n") + len(many) - 1  # the plan is asked once a batch


@given(
    st.lists(st.sampled_from(["G1 X5 Y6 E.1", "G0 X1", "G1 Y9 F900", "G1 X2 Y2 ; c", "G1 Z4", "G92 X1"]), max_size=12)
)
@settings(deadline=None)
def test_plain_lines_are_written_as_others_are(lines):
    text, seeds = ["G28", "G1 X9 Y9 Z1 F600", *lines], (3, 3)
    outputs = []
    for blank, seed in zip(("", "\t"), seeds, strict=True):
        output = rewritten("\n".join(blank + line for line in text).encode(), Bend(seed, parts=1))
        outputs.append(output.replace(b"\t", b""))
    assert outputs[0] == outputs[1]
