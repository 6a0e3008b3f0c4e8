"""What is said of believed parts: laws, not sentences."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from printmend.diagnosis.advice import advise
from printmend.diagnosis.named import diagnose, faults_of, misfits_of
from printmend.effects import EFFECTS, Acts, Of, Scene, title_of
from printmend.effects.effect import belt_places, drawn_places
from printmend.effects.words import Message, fault_of, is_of_motor
from printmend.infer.machine import DRAWS, Part
from printmend.machine import healthy_mechanism
from printmend.messages import ENGLISH, GERMAN, messages_of, restored, together, translated
from printmend.model.model import NOTE, WARNING
from printmend.printer import read_printer
from printmend.promise.words import in_a_table
from tests.believed import SCENES, part


def wave(count: int, order: int, size: float) -> list[float]:
    sizes = np.zeros(2 * count)
    sizes[order - 1] = size
    return sizes.tolist()


ACTING = [
    ("scale", 0, [0.4], (), "scale", 0.4),
    ("pulley", 1, wave(32, 2, 0.05), (), "harmonic-2", 0.1),  # c_k is k times the wave's amplitude
    ("play", 0, [0.3], (), "play", 0.3),
    ("breathing", 0, wave(16, 1, 0.1), (), "loose-belt", None),
    ("breathing", 0, wave(16, 2, 0.1), (), "play-by-angle", None),
    ("idler", 1, [0.0, 0.06], (31.4,), "period-31.4", 0.06),
    ("teeth", 1, [0.03, 0.0], (2.0,), "teeth", 0.03),
    ("teeth", 0, [0.03, 0.0], (0.2,), "ripple-1", 0.03),
    ("teeth", 0, [0.03, 0.0], (0.8,), "ripple-4", 0.03),
    ("teeth", 0, [0.03, 0.0], (0.1,), "ripple-0.5", 0.03),
    ("idler", 0, [0.05, 0.0], (32.0,), "period-32.0", 0.05),
    ("splice", 0, [0.5], (120.0, 4.0), "splice", 0.5),
    ("bump", 1, [-0.3], (90.0, 1.0), "bump", -0.3),
    ("crooked", 0, [0.1, *[0.0] * (EFFECTS["crooked"].count - 1)], (10.0, 210.0), "crooked", 0.1),
    ("distortion", 1, [0.1, *[0.0] * 48], (10.0, 210.0, 10.0, 210.0), "distortion", 0.1),
    ("rub", 0, [0.1, *[0.0] * 23], (10.0, 210.0), "rub", 0.2),
    ("place", 1, [0.3], (), "offset", 0.3),
    ("rail", 0, [0.0, 0.08], (90.0,), "wavy", 0.08),
]


def test_what_moves_a_belt_alone_is_told_of_its_motor() -> None:
    scene = SCENES["corexy"]
    belt = np.asarray(scene.printer.from_motor(np.eye(2)))[0]
    for law in EFFECTS.values():
        for shape in {term.shape for term in law.terms(scene) if term.where == 0 and law.of is not Of.INSTRUMENT}:
            moved = law.columns(drawn_places(scene), 0, shape, scene)
            across = belt[0] * moved[:, 1] - belt[1] * moved[:, 0]
            assert is_of_motor(law) or np.abs(across).max() > 1e-9, law.name


@pytest.mark.parametrize(("effect", "where", "sizes", "shape", "kind", "value"), ACTING)
def test_what_acts_is_named_with_its_size(
    effect: str, where: int, sizes: list[float], shape: tuple[float, ...], kind: str, value: float | None
) -> None:
    scene = SCENES["ender3"]
    parts = [part(effect, where, sizes, shape)]
    if effect == "breathing":  # of a belt that has play
        parts.insert(0, part("play", where, [0.5]))
    named = {fault.kind: fault for fault in faults_of(parts, scene)}
    assert kind in named
    fault = named[kind]
    assert fault.part == ("frame" if EFFECTS[effect].acts is Acts.WAVE else "xy"[where])
    assert abs(fault.value - (0.5 if value is None else value)) <= 4 * fault.sd
    assert not misfits_of(parts, scene)
    assert advise(fault).title
    assert fault.words in diagnose(parts, scene).summary


def test_a_smooth_course_is_told_once_whatever_parts_make_it() -> None:
    """A scale that an uneven belt takes back is none, and what is left of the belt is as large as its course."""
    scene, law = SCENES["ender3"], EFFECTS["uneven"]
    low, high = scene.motor_span_mm[0]
    share = np.linspace(0.0, 1.0, 401)
    places = belt_places(0, low + share * (high - low), 1.0)
    columns = law.columns(places, 0, (low, high), scene)[:, 0]
    swing, rise = 0.1 * np.cos(6 * np.pi * share), 0.7 * (high - low) / 100 * (share - 0.5)
    backs = np.linalg.lstsq(columns, np.stack([swing - swing.mean() - rise, -rise], axis=1), rcond=None)[0]
    scale = part("scale", 0, [0.7])
    both, alone = (
        faults_of([scale, Part("uneven", 0, (low, high), back, back[:, None] * scale.draws_mm / 0.7)], scene)
        for back in backs.T
    )
    (fault,) = both
    assert fault.kind == "warp"
    assert fault.value == pytest.approx(0.1, rel=0.1)
    assert max((fault.value for fault in alone), default=0.0) < 0.01  # a line's ends are no cosines


def test_a_frame_is_named_whole() -> None:
    leans = [part("skew", 0, [0.5]), part("skew", 1, [0.25])]
    (skew,) = faults_of(leans, SCENES["ender3"])
    assert (skew.part, skew.kind, skew.unit) == ("frame", "skew", "°")
    assert skew.value == pytest.approx(np.degrees(0.0075), abs=4 * skew.sd)
    (axes,) = faults_of([part("aspect", 0, [0.5])], SCENES["corexy"])
    assert (axes.kind, axes.unit) == ("axes", "%")
    assert axes.value == pytest.approx(0.5, abs=4 * axes.sd)


def test_play_is_named_once_by_its_most_telling_form() -> None:
    scene = SCENES["ender3"]
    low, high = scene.motor_span_mm[0]
    play, along_it = part("play", 0, [0.3]), part("friction", 0, [0.1, 0.0], (low, high))
    (grows,) = faults_of([play, along_it], scene)
    assert grows.kind == "friction"
    drawn = play.draws_mm[0] + along_it.draws_mm[0] * (low + high - 2 * scene.motor_middle_mm(0)) / 200
    assert grows.sd == pytest.approx(drawn.std(), rel=0.5)
    assert grows.value == pytest.approx(0.3, abs=0.02)
    (whole,) = faults_of([play, part("wear", 0, [0.2])], scene)
    assert whole.value == pytest.approx(0.5, abs=4 * whole.sd)  # as the print ended
    (worn,) = misfits_of([play, part("wear", 0, [0.2])], scene)
    assert worn.kind == "wear"
    (sticks,) = misfits_of([play, part("wear", 0, [-0.2])], scene)
    assert sticks.kind == "sticking"


@pytest.mark.parametrize(
    ("effect", "shape", "sizes", "grew", "shrank"),
    [
        ("uneven_play", (1.0, 100.0), [0.2], ("mm more play", "mm mehr Spiel"), ("mm less play", "mm weniger Spiel")),
        (
            "soft_play",
            (3.0,),
            [0.2],
            ("X gradually falls behind by", "bleibt X um"),
            ("X gradually runs ahead by", "eilt X um"),
        ),
        ("wear", (), [0.2], ("grew by", "mm zu"), ("shrank by", "mm ab")),
        ("warmth", (0.2,), [0.2, 0.0, 0.0, 0.0, 0.0, 0.0], ("X grew by", "dehnte sich"), ("X shrank by", "schrumpfte")),
        (
            "warmth",
            (0.2,),
            [0.0, 0.0, 0.2, 0.1, 0.0, 0.0],
            ("Y went out of square by", "Y wurde während"),
            ("Y went out of square by", "Y wurde während"),
        ),
        ("warmth", (0.2,), [0.2, 0.0, 0.0, 0.1, 0.0, 0.0], ("mm and Y by", "und Y um"), ("mm and Y by", "und Y um")),
    ],
)
def test_a_verb_says_which_way_and_no_sign_does(
    effect: str, shape: tuple[float, ...], sizes: list[float], grew: tuple[str, str], shrank: tuple[str, str]
) -> None:
    for sign, said in ((1, grew), (-1, shrank)):
        (told,) = misfits_of([part(effect, 0, [sign * size for size in sizes], shape)], SCENES["ender3"])
        for words, verb in zip((told.words, translated(told.words, GERMAN)), said, strict=True):
            assert verb in words
            assert re.search(r"[-+−]0\.", words) is None, words


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, 1.3])
def test_a_push_along_one_line_is_as_large_as_it_goes_either_way(angle_rad: float) -> None:
    way = np.cos(angle_rad), np.sin(angle_rad)
    pushes = [part("wobble", axis, [0.25 * way[axis], 0.0, 0.0, 0.0]) for axis in range(2)]
    (fault,) = [each for each in faults_of(pushes, SCENES["ender3"]) if each.kind == "wobble-1"]
    assert fault.value == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("slack_mm", [0.2, 1.2])
def test_a_loose_shaft_and_a_loose_belt_are_told_apart_by_their_laws(slack_mm: float, order: int) -> None:
    """A turn's Fourier coefficients are those of branches: of U(θ ± b/2), or of spans that see both sides."""
    scene = SCENES["ender3"]
    turn = 2 * np.pi * np.arange(256) / 256
    slack_rad = 2 * np.pi * slack_mm / scene.turns_mm[0]

    def kinds(lower_mm: np.ndarray, upper_mm: np.ndarray) -> set[str]:
        def sizes(mm: np.ndarray, count: int) -> list[float]:
            found = np.fft.rfft(mm)[1 : count + 1] / (len(turn) / 2)
            return [*found.real, *-found.imag]

        play = upper_mm - lower_mm
        parts = [
            part("play", 0, [float(play.mean())]),
            part("breathing", 0, sizes(play, 16)),
            part("pulley", 0, sizes((lower_mm + upper_mm) / 2, 32)),
        ]
        return {fault.kind for fault in faults_of(parts, scene)}

    def error_mm(angle: np.ndarray) -> np.ndarray:
        return np.asarray(0.3 / order * np.sin(order * angle + 0.7))

    shaft = kinds(error_mm(turn - slack_rad / 2) - slack_mm / 2, error_mm(turn + slack_rad / 2) + slack_mm / 2)
    assert "play-by-angle" in shaft
    assert "loose-belt" not in shaft
    if order % 2:
        belt = kinds(error_mm(turn) - slack_mm, -error_mm(turn) + slack_mm)
        assert "loose-belt" in belt
        assert "play-by-angle" not in belt


@pytest.mark.parametrize("order", [1, 3])
def test_what_fades_along_a_belt_may_be_an_idler_unless_it_has_corners(order: int) -> None:
    sizes = [0.0] * 6
    sizes[(order - 1) // 2] = 0.1
    (fault,) = faults_of([part("elastic", 0, sizes, SCENES["ender3"].motor_span_mm[0])], SCENES["ender3"])
    assert fault.kind == "elastic"
    assert ("idler" in fault.words) == (order == 1)


def test_no_effect_is_no_fault() -> None:
    for preset, scene in SCENES.items():
        found = diagnose([], scene)
        assert not found.faults
        assert found.summary == "; ".join(f"{name.upper()} healthy" for name in read_printer(preset).motors)
        assert not misfits_of([], scene)
        assert healthy_mechanism(scene.printer).frame.is_identity


def test_what_most_machines_do_not_have_is_neither_named_nor_certain() -> None:
    scene, rng = SCENES["ender3"], np.random.default_rng(1)
    seldom, usual = rng.permutation(DRAWS) < DRAWS // 10, rng.permutation(DRAWS) < DRAWS * 3 // 4
    assert not faults_of([part("play", 0, [0.3], there=seldom)], scene)
    assert not misfits_of([part("drift", 0, [0.3], there=seldom)], scene)
    (said,) = misfits_of([part("drift", 0, [0.3], there=usual)], scene)
    assert "not certain" in said.words
    (sure,) = misfits_of([part("drift", 0, [0.3])], scene)
    assert "not certain" not in sure.words


def test_what_is_certain_and_does_not_act_is_named_and_no_motor_is_healthy() -> None:
    scene, usual = SCENES["corexy"], np.arange(DRAWS) % 10 > 0
    for one in (part("play", 0, [0.3]), part("scale", 0, [0.4]), part("skew", 0, [0.5])):
        left = replace(one, acts_mm=0 * one.acts_mm)
        (fault,), (acting,) = faults_of([left], scene), faults_of([one], scene)
        assert (fault.kind, fault.is_mended, fault.is_doubtful) == (acting.kind, False, True)
        assert fault.value == pytest.approx(acting.value, rel=0.05)
        assert "(not corrected)" in diagnose([left], scene).summary
        assert "not surely help" in advise(fault_of(fault.row)).software
    joint, near = (part("splice", 0, [0.5], (at, 4.0)) for at in (120.0, 120.5))
    drawn = [replace(joint, draws_mm=0 * joint.draws_mm), replace(near, acts_mm=0 * near.acts_mm)]
    assert [fault.is_mended for fault in faults_of(drawn, scene)] == [True]  # no machine has the very shape that acts
    play = part("play", 0, [0.3], there=usual)
    left = diagnose([replace(play, acts_mm=0 * play.acts_mm)], scene).summary
    assert "A healthy" not in left
    assert "B healthy" in left
    grown = diagnose([part("wear", 0, [0.3]), part("place", 1, [0.1])], scene)  # it acts, and is play from now on
    assert [each.kind for each in grown.faults if each.part == "a" and each.is_mended] == ["play"]
    soft, drift = part("soft_play", 1, [0.3], (4.0,)), part("drift", 0, [0.3])  # one is the printer's, one the print's
    assert diagnose([soft, drift], scene).summary == "A healthy; B is off by 0.07 mm, which mending cannot correct"
    for wave_mm, word in ((0.05, "Y has no certain fault"), (0.001, "Y healthy")):  # a note says whose it may be
        told = diagnose([part("carriage_wave", 1, [wave_mm, 0.0], (40.0,))], SCENES["ender3"]).summary
        assert told == f"X healthy; {word}"
        later = diagnose([part("play", 0, [0.3])], SCENES["ender3"], before=told).summary
        assert re.fullmatch(f"X belt play [^;]*; {word}", later)


@pytest.mark.parametrize("preset", SCENES)
def test_play_below_0_is_the_firmwares_and_says_what_to_set(preset: str) -> None:
    scene, excess = SCENES[preset], part("play", 1, [-0.2])
    (fault,) = faults_of([excess], scene)
    assert (fault.kind, fault.is_mended, fault.is_doubtful) == ("overcompensation", False, False)
    assert fault.value == pytest.approx(0.2, abs=4 * fault.sd)
    advice = advise(fault_of(fault.row), corexy=preset == "corexy")
    assert "only the firmware" in advice.software
    assert advice.urgency == "left"
    assert in_a_table(fault.kind)[0] == title_of(fault.kind)  # as certain as the finding
    assert "(M425 Y in Marlin" in advice.repair  # of a CoreXY it is motor B's, too
    name, (told,) = scene.printer.motors[1].upper(), misfits_of([excess], scene)
    assert f"Reduce its compensation for {name} by 0.20 mm (M425 Y in Marlin" in told.words
    assert f"Ausgleich für {name} um 0,20 mm verringern" in translated(told.words, GERMAN)
    assert "healthy" not in diagnose([excess, part("play", 0, [0.2])], scene).summary
    (grows,) = faults_of([part("friction", 0, [0.1, 0.0], scene.motor_span_mm[0])], scene)
    assert (grows.kind, grows.is_mended) == ("friction", True)


def test_what_cannot_be_told_apart_is_said_together() -> None:
    scene, either = SCENES["ender3"], np.arange(DRAWS) % 2 == 0
    (found,) = misfits_of(
        [part("drift", 0, [0.3], there=either), part("creep", 0, [0.3], (0.7,), there=~either)], scene
    )
    one, other = found.words.split(" (or ", 1)
    assert ("drift" in one, other) in ((True, "a shift that slows down)"), (False, "a shift that grows evenly)"))
    (shared,) = misfits_of(
        [part("step", 0, [0.3], (0.5,), there=either), part("step", 0, [0.3], (0.51,), there=~either)], scene
    )
    assert "(or " not in shared.words  # one moment, a little earlier or later
    assert "not certain" not in shared.words


def test_rivals_are_few_short_names_and_one_of_another_part_says_so() -> None:
    """Only one of a motor's own needs no part; the frame has none."""
    scene, which = SCENES["corexy"], np.repeat(np.arange(5), [29, 19, 14, 12, DRAWS - 74])
    rivals = [
        part("scale", 1, [0.4], there=which == 0), part("joint", 0, [0.3], (90.0, 2.0), there=which == 1),
        part("wear", 0, [0.3], there=which == 2), part("skew", 0, [0.3], there=which == 3),
    ]  # fmt: skip
    ours = part("scale", 0, [0.4], there=which == 4)
    for count, said in (
        (1, "(or B: wrong steps per mm or pulley size)"),
        (2, "(or B: wrong steps per mm or pulley size, or X: a guide in two pieces)"),
        (4, "(or B: wrong steps per mm or pulley size, or X: a guide in two pieces)"),
    ):
        (fault, *_) = faults_of([ours, *rivals[:count]], scene)
        assert fault.words.endswith(said)
    for rival, name in ((rivals[2], "play that grows while it prints"), (rivals[3], "axes that are not square")):
        (fault, *_) = faults_of([ours, rival], scene)
        assert fault.words.endswith(f"(or {name})")


@pytest.mark.parametrize("preset", SCENES)
@pytest.mark.parametrize("effect", [name for name, each in EFFECTS.items() if each.acts is Acts.NOT])
def test_what_cannot_act_is_told_and_is_no_fault(effect: str, preset: str) -> None:
    scene = SCENES[preset]
    if effect in ("origin", "stretch"):
        return  # what every scan has is said of its scale
    for one in _terms(effect, scene):
        parts = [part(effect, one.where, [0.2] * len(one.sd_mm), one.shape)]
        assert not faults_of(parts, scene)
        (told,) = misfits_of(parts, scene)
        assert told.size_mm > 0
        assert told.severity in (NOTE, WARNING)
        assert re.search(r"\d", told.words)


def _terms(effect: str, scene: Scene) -> Iterator:
    """Yield the first term of each place."""
    seen = set()
    for term in EFFECTS[effect].terms(scene):
        if term.where not in seen:
            seen.add(term.where)
            yield term


def test_an_effect_from_outside_says_itself_in_both_languages_wherever_it_is_kept() -> None:
    kinked = Message("{a} belt is kinked by {b} mm", "Der Riemen von {a} ist um {b} mm geknickt")
    words = together("; ", [kinked("X", 0.25), "plain"])
    again = restored({"words": str(words)}, json.loads(json.dumps(messages_of(words))))["words"]
    for each in (words, again):
        assert each == "X belt is kinked by 0.25 mm; plain"
        assert translated(each, GERMAN) == "Der Riemen von X ist um 0,25 mm geknickt; plain"
        assert translated(each, ENGLISH) == each


def test_a_fine_pattern_is_named_by_what_makes_it() -> None:
    said = {}
    for period_mm in (2.0, 0.8, 0.4, 0.2, 0.1):
        (fault,) = faults_of([part("teeth", 0, [0.03, 0.0], (period_mm,))], SCENES["ender3"])
        said[period_mm] = (fault.words.partition(" 0.0")[0], advise(fault))
    names = {period_mm: words for period_mm, (words, _) in said.items()}
    assert names == {
        2.0: "ripple of belt teeth", 0.8: "ripple of motor poles", 0.4: "ripple of pairs of full steps",
        0.2: "ripple of full steps", 0.1: "ripple of half steps",
    }  # fmt: skip
    assert "belt's tension" in said[2.0][1].repair
    assert all("current" in said[period_mm][1].repair for period_mm in (0.8, 0.4, 0.2, 0.1))
    assert all("another speed" in one.repair for _, one in said.values())
    (idler,) = faults_of([part("idler", 0, [0.05, 0.0], (32.0,))], SCENES["ender3"])
    assert "an idler of 16 teeth?" in idler.words
