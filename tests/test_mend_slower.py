"""A limit on the time that mending adds, and the line types by which it is kept."""

from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive
from printmend.corruption.transmission import Ripple
from printmend.errors import RefusedError
from printmend.gcode import kernels as k
from printmend.gcode.machine import initial_state
from printmend.gcode.read import interpret_text
from printmend.mend import mend_gcode
from printmend.model import write_model
from printmend.plan import Fineness, start
from printmend.plan.kernels.lookup import COARSEST_MM
from tests.mending import BENT, ENDER3, START, exactly
from tests.test_mend_cli import run

TYPES = {
    k.ROLE_OUTER: [";TYPE:External perimeter", ";TYPE:WALL-OUTER", "; FEATURE: Outer wall", "; feature outer perimeter",
                   ";TYPE:Overhang perimeter"],
    k.ROLE_INNER: [";TYPE:Perimeter", ";TYPE:WALL-INNER", ";TYPE:Inner wall", "; feature inner perimeter"],
    k.ROLE_SOLID: [";TYPE:Top solid infill", ";TYPE:SKIN", "; FEATURE: Bottom surface", ";TYPE:Bridge infill",
                   ";TYPE:Internal solid infill", ";TYPE:Ironing", ";TYPE:Gap fill"],
    k.ROLE_INFILL: [";TYPE:Internal infill", ";TYPE:FILL", "; FEATURE: Sparse infill", "; feature infill"],
    k.ROLE_ASIDE: [";TYPE:Skirt/Brim", ";TYPE:SUPPORT-INTERFACE", "; FEATURE: Prime tower", ";TYPE:Support material"],
    k.ROLE_UNKNOWN: [";TYPE:Custom", ";TYPE:", "; FEATURE: something new"],
}  # fmt: skip


@pytest.mark.parametrize(("role", "comment"), [(role, each) for role, group in TYPES.items() for each in group])
def test_comments_of_slicers_name_the_role(role: int, comment: str) -> None:
    text = f";TYPE:FILL\n{comment}\n; outer wall, says a remark\nG1 X1 Y1 E1\ng1x2y2e2\n"
    records = interpret_text(np.frombuffer(text.encode(), np.uint8), initial_state())
    assert (records["flags"] >> k.ROLE_SHIFT & k.ROLE_MASK == role).all()


def part(types: bool = True) -> bytes:
    """Two layers of the same small rings: outer walls below, infill above."""
    rows = [START, b"M204 S300\n"]
    for z, name in ((0.2, b"Outer wall"), (0.4, b"Sparse infill")):
        rows.append(b";LAYER_CHANGE\nG1 Z%.1f F600\n" % z)
        rows.append(b";TYPE:%b\n" % name if types else b"")
        for middle in range(60, 160, 6):
            angle = np.linspace(0, 2 * np.pi, 25)
            ring = np.stack([middle + 2.5 * np.cos(angle), 100 + 2.5 * np.sin(angle)], axis=1)
            rows.append(b"G0 X%.3f Y%.3f F9000\n" % tuple(ring[0]))
            rows += [b"G1 X%.3f Y%.3f E0.02 F3000\n" % tuple(place) for place in ring[1:]]
    return b"".join(rows)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("slower") / "part.gcode"
    path.write_bytes(part())
    return path


def test_a_limit_that_is_kept_anyway_changes_nothing(source: Path, tmp_path: Path) -> None:
    plain, limited = tmp_path / "plain.gcode", tmp_path / "limited.gcode"
    mend_gcode(source, exactly(BENT), plain)
    done = mend_gcode(source, exactly(BENT), limited, fineness=Fineness(slower=1.0))
    assert plain.read_bytes() == limited.read_bytes()
    assert not done.prediction.warnings


def test_what_matters_least_pays_for_the_time(source: Path, tmp_path: Path) -> None:
    plain = mend_gcode(source, exactly(BENT), tmp_path / "plain.gcode").prediction
    assert plain.duration is not None
    least = mend_gcode(
        source, exactly(BENT), tmp_path / "least.gcode", force=True, fineness=Fineness(slower=0.0)
    ).prediction
    assert least.duration is not None
    assert 0.0 < least.duration.share < plain.duration.share
    limit = 0.6 * plain.duration.share + 0.4 * least.duration.share
    limited = mend_gcode(source, exactly(BENT), tmp_path / "limited.gcode", fineness=Fineness(slower=limit)).prediction
    assert limited.duration is not None
    assert limited.duration.share <= limit
    walls, infill = (layer["after_rms_mm"] for layer in limited.layers)
    assert plain.layers[0]["after_rms_mm"] * 0.9 < walls < 0.6 * infill
    assert infill > 1.5 * plain.layers[1]["after_rms_mm"]
    (said,) = limited.warnings
    assert said.startswith("to stay within the time limit, lines follow the path less closely [mm]: infill within")
    assert "outer walls" in said
    assert "inner walls" not in said, "there are none"


def test_a_limit_that_cannot_be_kept_is_refused(source: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.gcode"
    with pytest.raises(RefusedError, match=r"printing would take over 0 % longer \(.* as coarse as they may be"):
        mend_gcode(source, exactly(BENT), output, fineness=Fineness(slower=0.0))
    assert not output.exists()


def test_without_line_types_all_lines_are_alike(tmp_path: Path) -> None:
    source = tmp_path / "part.gcode"
    source.write_bytes(part(types=False))
    done = mend_gcode(source, exactly(BENT), tmp_path / "o.gcode", force=True, fineness=Fineness(slower=0.0))
    assert "lines without a type within 0.200" in done.prediction.warnings[0]
    below, above = (layer["after_rms_mm"] for layer in done.prediction.layers)
    assert below == pytest.approx(above, rel=0.2)


def test_prices_rise_from_nothing_to_the_coarsest() -> None:
    def drawn(ripple: Ripple | None, ease: float = 0.0) -> dict[int, float]:
        planner = start(exactly(Corruption((Drive(ripple=ripple), Drive())).lower(ENDER3)).mechanism)
        planner.begin(ease=ease)
        return dict(enumerate(planner.tolerances_mm[: k.ROLE_ASIDE + 1]))

    assert set(drawn(None).values()) == {0.01}
    sharp = Ripple((0.02 / ENDER3.axes[0].mm_per_step,), (0.4 / ENDER3.axes[0].mm_per_step,), (1.0,))
    for half in (drawn(None, 2.0), drawn(sharp)):
        assert half[k.ROLE_INFILL] > half[k.ROLE_SOLID] > half[k.ROLE_INNER] > half[k.ROLE_UNKNOWN] > half[k.ROLE_OUTER]
        assert half[k.ROLE_OUTER] < 0.02
    assert set(drawn(None, Fineness().most_ease).values()) == {COARSEST_MM}


@pytest.mark.parametrize(("said", "code"), [("90%", 0), ("90", 0), ("x%", 2), ("-3%", 2), ("nan", 2), ("0%", 3)])
def test_the_command_takes_a_percentage(said: str, code: int, source: Path, tmp_path: Path) -> None:
    write_model(tmp_path / "m.mend.json", exactly(BENT))
    done = run("mend", source, "-m", tmp_path / "m.mend.json", "-o", tmp_path / "o.gcode", "--slower", said)
    assert code == (3 if isinstance(done.exception, RefusedError) else done.exit_code), done.output


def test_walls_keep_their_width_by_many_moves(tmp_path: Path) -> None:
    pitch = ENDER3.axes[0].mm_per_step
    model = exactly(Corruption((Drive(ripple=Ripple((0.02 / pitch,), (2.0 / pitch,), (1.0,))), Drive())).lower(ENDER3))
    source = tmp_path / "wall.gcode"
    wall, infill = b";TYPE:External perimeter\nG1 X120 E2 F1800\n", b";TYPE:Internal infill\nG1 Y80 E1\nG1 X60 E2\n"
    source.write_bytes(START + wall + infill)
    prediction = mend_gcode(source, model, tmp_path / "out.gcode", force=True).prediction
    assert prediction.commands > 20 * prediction.moves


def test_a_ripple_of_steps_costs_few_moves_and_no_more_than_the_tolerance(tmp_path: Path) -> None:
    """Sparse infill pays first: its lines take less than half of the moves."""
    pitch = ENDER3.axes[0].mm_per_step
    drive = Drive(ripple=Ripple((0.02 / pitch,), (0.4 / pitch,), (1.0,)))
    model = exactly(Corruption((drive, drive)).lower(ENDER3))
    commands = {}
    for name in (b"External perimeter", b"Internal infill"):
        (source := tmp_path / "part.gcode").write_bytes(
            START + b";TYPE:%b\nG1 X120 Y120 E2 F1800\nG1 X150 Y95 E4\n" % name
        )
        done = mend_gcode(source, model, tmp_path / "out.gcode", force=True).prediction
        assert "to keep the number of moves low" in done.warnings[-1]
        commands[name] = done.commands
        if name.startswith(b"External"):
            assert done.after.rms_mm <= Fineness().tolerance_mm
    assert commands[b"Internal infill"] < commands[b"External perimeter"] / 2
