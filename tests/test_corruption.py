"""Corruptions: the equations of physics.md, composition, TOML, refusals."""

import math

import numpy as np
import pytest

from printmend.corruption import (
    HEALTHY,
    Cause,
    Corruption,
    CrookedFrame,
    Drive,
    EccentricBore,
    ElasticBelt,
    Ellipse,
    FlatSpot,
    FourierHull,
    Friction,
    GainTable,
    LooseBelt,
    Play,
    Polygon,
    PublishedHull,
    Ripple,
    SetScrew,
    TabulatedHull,
    WrongRadius,
    cause_of,
    corruption_of,
    parse_corruption,
    published_names,
)
from printmend.errors import ConfigError
from printmend.machine import Mechanism, Transmission
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend.units import radius_mm
from printmend_lab.sampling import sample
from tests.naive_twin import hull_support_mm

R0 = radius_mm(40.0)
PHI = np.linspace(0, 2 * math.pi, 721)


def lowered(drive: Drive, printer: Printer) -> Transmission:
    mechanism = Corruption((drive, Drive())).lower(printer)
    assert isinstance(mechanism, Mechanism)
    return mechanism.transmissions[0]


@pytest.mark.parametrize(
    ("pulley", "outline"),
    [
        (EccentricBore(1.2, 0.7), lambda t: R0 * np.exp(1j * t) + 1.2 * np.exp(0.7j)),
        (Ellipse(7.0, 5.0, 0.4), lambda t: np.exp(0.4j) * (7 * np.cos(t) + 5j * np.sin(t))),
        (
            Polygon((6.0, 7.0, 6.5, 6.2), 0.3),
            lambda t: np.array([6.0, 7.0, 6.5, 6.2]) * np.exp(1j * (0.3 + np.pi / 2 * np.arange(4))),
        ),
        (FlatSpot(1.0, 2.0), lambda t: R0 * np.exp(1j * t[(np.cos(t - 2.0) <= 1 - 1.0 / R0)])),
    ],
    ids=["eccentric", "ellipse", "polygon", "flat"],
)
def test_support_is_that_of_the_outline(pulley, outline) -> None:
    points = outline(np.linspace(0, 2 * math.pi, 20_001))
    points = points[np.isfinite(points)]
    expected = hull_support_mm(np.stack([points.real, points.imag], axis=1), PHI)
    np.testing.assert_allclose(pulley.support_mm(PHI, R0), expected, atol=2e-3)


@pytest.mark.parametrize("name", published_names())
def test_published_hulls_hold_the_shaft(name: str) -> None:
    h = PublishedHull(name).support_mm(PHI, R0)
    assert h.min() > 2.4
    assert h.max() < 9.1


def test_published_hulls_agree_with_their_table(corpus) -> None:
    table = np.genfromtxt(corpus / "hulls" / "authors_hulls.csv", delimiter=",", names=True)
    for name in published_names():
        error = PublishedHull(name).support_mm(table["angle_rad"], R0) - table[f"{name}_0_mm"]
        assert np.sqrt(np.mean(error**2)) < 0.07, name
        # What counts is the position, the integral over the angle: rounded corners, and the jump in the
        # authors' table of the square, hardly show there.
        assert np.abs(np.cumsum(error - error.mean()) * 2 * math.pi / len(error)).max() < 0.01, name
        assert abs(error.mean()) < 1e-5, name


def test_one_turn_unwinds_one_perimeter(ender5: Printer) -> None:
    pulley = FourierHull(6.1, (0.4, 0.2), (0.1, -0.3))
    table = lowered(Drive(pulley=pulley), ender5)
    lower, _ = table.branches_mm(np.array([10.0, 50.0, 90.0]))
    np.testing.assert_allclose(np.diff(lower), 2 * math.pi * 6.1, atol=1e-6)


def test_position_is_the_integral_of_the_support(ender5: Printer) -> None:
    """dx/dθ = h(−θ), eq. 1, by finite differences of the table."""
    pulley = EccentricBore(1.0, 0.6)
    table = lowered(Drive(pulley=pulley), ender5)
    motor = np.linspace(1, 219, 300)
    delta = 0.05
    slope = (table.branches_mm(motor + delta)[0] - table.branches_mm(motor - delta)[0]) / (2 * delta)
    np.testing.assert_allclose(slope, pulley.support_mm(-motor / R0, R0) / R0, atol=1e-4)


def test_a_loose_belt_breathes_with_the_eccentricity(ender5: Printer) -> None:
    """Eq. 6: an eccentricity e modulates the play by 4e peak to peak."""
    table = lowered(Drive(pulley=EccentricBore(0.5), belt=LooseBelt(1.5, 1.5)), ender5)
    play = table.upper_mm - table.lower_mm
    assert play.max() - play.min() == pytest.approx(4 * 0.5, abs=1e-3)


def test_even_harmonics_leave_the_play_alone(ender5: Printer) -> None:
    table = lowered(Drive(pulley=Ellipse(7.0, 5.5, 0.2), belt=LooseBelt(0.3, 0.5)), ender5)
    np.testing.assert_allclose(table.upper_mm - table.lower_mm, 0.8, atol=1e-6)


def test_elastic_belt_at_the_motor_is_the_pulley_and_in_the_middle_the_even_part(ender5: Printer) -> None:
    pulley = EccentricBore(1.0)
    table = lowered(Drive(pulley=pulley, belt=ElasticBelt(loop_mm=400.0, motor_mm=0.0)), ender5)
    delta = 0.1

    def gain(motor: np.ndarray) -> np.ndarray:
        return (table.branches_mm(motor + delta)[0] - table.branches_mm(motor - delta)[0]) / (2 * delta)

    near, far = np.array([1.0]), np.array([200.0])
    assert gain(near)[0] == pytest.approx(pulley.support_mm(-near / R0, R0)[0] / R0, abs=3e-3)
    assert gain(far)[0] == pytest.approx(1.0, abs=3e-3)


def test_set_screw_play_of_a_round_pulley_is_ordinary_play(ender5: Printer) -> None:
    screw = lowered(Drive(shaft=SetScrew(0.8 / R0)), ender5)
    belt = lowered(Drive(belt=Play(0.8)), ender5)
    np.testing.assert_allclose(screw.lower_mm, belt.lower_mm, atol=1e-9)
    np.testing.assert_allclose(screw.upper_mm, belt.upper_mm, atol=1e-9)


def test_friction_grows_away_from_the_motor(ender5: Printer) -> None:
    friction = Friction(force_n=5.0, stiffness_n=1e4, loop_mm=600.0, motor_mm=0.0)
    table = lowered(Drive(friction=friction), ender5)
    lower, upper = table.branches_mm(np.array([0.0, 100.0, 200.0]))
    np.testing.assert_allclose(
        upper - lower, [0.0, 2 * 5 / 1e4 * 100 * 500 / 600, 2 * 5 / 1e4 * 200 * 400 / 600], atol=1e-9
    )


def test_skew_is_a_shear(ender5: Printer) -> None:
    mechanism = Corruption(frame=CrookedFrame(skew_deg=2.0)).lower(ender5)
    moved = mechanism.frame.apply(np.array([[10.0, 0.0], [10.0, 100.0]]))
    np.testing.assert_allclose(moved, [[10.0, 0.0], [10.0 + 100 * math.tan(math.radians(2)), 100.0]], atol=1e-12)


def test_a_wavy_guide_pushes_its_axis_along_the_other(ender5: Printer) -> None:
    frame = CrookedFrame(x_wave_mm=0.2, x_wave_period_mm=100.0, x_wave_phase_rad=0.5, y_wave_mm=-0.1).lower(ender5)
    place = np.array([[30.0, 135.0], [147.5, 110.0]])
    x_mm = 30 + 0.2 * np.sin(2 * np.pi * 0.25 + 0.5), 147.5 + 0.2 * np.sin(0.5)
    y_mm = 135 - 0.1 * np.sin(2 * np.pi * -80 / 150), 110 - 0.1 * np.sin(2 * np.pi * 37.5 / 150)
    np.testing.assert_allclose(frame.apply(place), np.stack([x_mm, y_mm], axis=1), atol=1e-12)
    np.testing.assert_allclose(frame.invert(frame.apply(place)), place, atol=1e-8)


def test_frame_inverts(ender5: Printer, rng: np.random.Generator) -> None:
    frame = CrookedFrame(3.0, 1.04, 0.97, 0.5, -0.4).lower(ender5)
    xy = rng.uniform(0, 220, (200, 2))
    np.testing.assert_allclose(frame.invert(frame.apply(xy)), xy, atol=1e-8)


TAU, LOOP_MM, MIDDLE_MM = 2 * math.pi, 600.0, 110.0
# On both motors: a part as a data sheet has it, and the effects that are the same machine.
SAME: dict[str, tuple[Drive, list[str]]] = {
    "play": (Drive(belt=Play(0.3)), ["play:size_mm=0.3"]),
    "set screw": (Drive(shaft=SetScrew(0.3 / R0)), ["play:size_mm=0.3"]),
    "radius": (Drive(pulley=WrongRadius(1.004 * R0)), ["scale:percent=0.4"]),
    "eccentric": (Drive(pulley=EccentricBore(0.5, 0.7)), [f"pulley:size_mm=0.5,phase_rad={math.pi / 2 - 0.7}"]),
    "oval": (
        Drive(pulley=FourierHull(R0, (0.0, 0.2), (0.0, 0.0))),
        [f"pulley:harmonic=2,size_mm=0.1,phase_rad={math.pi / 2}"],
    ),
    "loose": (
        Drive(pulley=EccentricBore(0.2), belt=LooseBelt(0.8, 0.8)),
        ["play:size_mm=1.6", f"breathing:size_mm=0.4,phase_rad={-math.pi / 2}"],
    ),
    "ripple": (
        Drive(ripple=Ripple((0.05,), (4.0,), (0.6,))),
        [f"teeth:period_mm=0.8,size_mm=0.01,phase_rad={math.pi / 2 - 0.6}"],
    ),
    "friction": (  # B = c L1 (L − L1)/L with L1 = m, about the middle of the bed
        Drive(friction=Friction(5.0, 1e4, LOOP_MM, 0.0)),
        [
            f"play:size_mm={1e-3 * MIDDLE_MM * (LOOP_MM - MIDDLE_MM) / LOOP_MM}",
            f"friction:size_mm={1e-1 * (LOOP_MM - 2 * MIDDLE_MM) / LOOP_MM},square_mm={-1e1 / LOOP_MM}",
        ],
    ),
}


@pytest.mark.parametrize("name", SAME)
def test_a_part_and_its_effects_are_one_law(name: str, ender5: Printer, rng: np.random.Generator) -> None:
    drive, texts = SAME[name]
    causes = tuple(cause_of(f"{text},on={axis}") for text in texts for axis in "xy")
    path = np.vstack([ender5.home_mm, rng.uniform(20, 200, (300, 2))])
    ours, theirs = (
        Twin.of(each, ender5).follow(path) for each in (Corruption((drive, drive)), Corruption(causes=causes))
    )
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-6)


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (CrookedFrame(skew_deg=2.0), "skew:on=x,angle_deg=2"),
        (CrookedFrame(x_bow_mm=0.4), "bent:x_yy_mm=0.4"),
        (CrookedFrame(y_bow_mm=-0.3), "bent:y_xx_mm=-0.3"),
        (  # an effect's wave counts from 0, a frame's from the middle of the bed
            CrookedFrame(x_wave_mm=0.1, x_wave_period_mm=90, x_wave_phase_rad=0.5),
            f"rail:on=y,period_mm=90,size_mm=0.1,phase_rad={math.pi / 2 - 0.5 + TAU * MIDDLE_MM / 90}",
        ),
    ],
    ids=["skew", "x bow", "y bow", "rail"],
)
def test_a_frame_and_its_effects_are_one_law(
    frame: CrookedFrame, text: str, ender5: Printer, rng: np.random.Generator
) -> None:
    path = np.vstack([ender5.home_mm, rng.uniform(20, 200, (300, 2))])
    ours, theirs = (Twin.of(each, ender5).follow(path) for each in (Corruption(frame=frame), corruption_of([text])))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("banana", "no such name"),
        ("pulleys", "did you mean pulley"),
        ("play:size_mm", "key=value"),
        ("play:size=1", "'size'"),
        ("play:on=z,size_mm=1", "'z'"),
        ("bent:on=y,x_yy_mm=1", "whole machine"),
        ("play:size_mm=nan", "size_mm within"),
        ("pulley:harmonic=40", "harmonic"),
        ("elastic:harmonic=2", "harmonic out of 1, 3, 5"),
        ("uneven_play:axis=7", "axis as x or y"),
        ("step:at_share=2", "at_share within 0 to 1"),
        ("splice:on=x,size_mm=-9,width_mm=2", "moves forwards"),
        ("aspect:percent=1", "cannot have"),
        ("play:seed=-1", "seed"),
        ("loose:size_mm=-1", "0 or more"),
        ("play:size_mm=1,size_mm=2", "size_mm twice"),
        ("no/such/file", "no such file"),
        ("homing:switch=magic", "switch as one of"),
        ("homing:on=x", "whole machine"),
        ("refit:teeth=1.5", "whole number of teeth"),
        ("filament:polymer=wood", "begins with"),
        ("filament:size_mm=1", "keys out of polymer"),
        ("filaments", "did you mean filament"),
        ("x" * 5000, "no such name"),
    ],
)
def test_a_wrong_effect_is_named(text: str, named: str, ender5: Printer) -> None:
    with pytest.raises(ConfigError, match=named):
        Twin.of(corruption_of([text]), ender5)


def test_what_an_effect_leaves_out_is_drawn_from_its_seed(ender5: Printer) -> None:
    steep = cause_of("teeth:on=x,period_mm=0.2", seed=8).part(ender5)  # a size that is drawn leaves the belt going on
    assert 2 * math.pi / 0.2 * np.hypot(*steep.sizes_mm) < 1
    one, same, other = (cause_of("splice:size_mm=0.5", seed=seed).part(ender5) for seed in (1, 1, 2))
    assert (one.where, one.shape) == (same.where, same.shape) != (other.where, other.shape)
    assert one.sizes_mm == same.sizes_mm == other.sizes_mm == [0.5]
    mild = [
        abs(float(Cause("play", "x", seed=seed, severity="realistic").part(ender5).sizes_mm[0])) for seed in range(60)
    ]
    hard = [abs(float(Cause("play", "x", seed=seed).part(ender5).sizes_mm[0])) for seed in range(60)]
    assert np.median(mild) < 0.2 < np.median(hard)


def test_a_homing_scatters_as_its_switch_does(ender5: Printer) -> None:
    def sd_mm(text: str) -> float:
        turn_mm = 4 * ender5.x.mm_per_step
        shifts = np.array([cause_of(text, seed=seed).made(ender5).shift_mm for seed in range(400)])
        return float((shifts - turn_mm * np.rint(shifts / turn_mm)).std())

    assert sd_mm("homing:switch=optical") < 0.3 * sd_mm("homing:switch=sensorless")
    assert sd_mm("homing:scatter_mm=0.05,turn_share=0") == pytest.approx(0.05, rel=0.1)


def test_a_belt_is_back_in_its_place_after_a_whole_turn(ender5: Printer, rng: np.random.Generator) -> None:
    bent, path = Drive(pulley=EccentricBore(0.4, 1.0)), np.vstack([ender5.home_mm, rng.uniform(20, 200, (50, 2))])

    def printed(*texts: str) -> np.ndarray:
        return Twin.of(Corruption((bent, bent), causes=tuple(map(cause_of, texts))), ender5).follow(path)

    teeth = round(ender5.x.mm_per_turn / 2)
    assert np.abs(printed(f"refit:teeth={teeth}") - printed()).max() < 1e-6
    moved = np.abs(printed("refit:on=x,teeth=5") - printed()).max(axis=0)
    assert moved[0] > 0.1
    assert moved[1] < 1e-9


def test_a_filament_shrinks_as_its_polymer_does_and_by_axis(ender5: Printer) -> None:
    drawn = {
        polymer: np.array([
            [part.sizes_mm[0] for part in cause_of(f"filament:polymer={polymer}", seed=seed).made(ender5).parts[:2]]
            for seed in range(200)
        ])
        for polymer in ("pla-black", "pa")
    }  # fmt: skip
    assert drawn["pla-black"].mean() == pytest.approx(0.3, abs=0.03)
    assert drawn["pa"].mean() == pytest.approx(1.2, abs=0.1)
    assert np.corrcoef(*drawn["pa"].T)[0, 1] < 0.3
    text = "filament:x_percent=0.5,y_percent=0.2,outline_mm=0.05,hole_mm=0.12,foot_mm=0.15,corner_mm=0.02"
    twin = Twin.of(corruption_of([text]), ender5)
    assert twin.wider_mm == pytest.approx(0.05)
    assert (twin.beads.hole_mm, twin.beads.foot_mm, twin.beads.corner_mm) == pytest.approx((0.07, 0.15, 0.02))
    ends = np.array([ender5.home_mm, [10.0, 10.0], [210.0, 210.0]])
    assert np.diff(twin.follow(ends)[1:], axis=0)[0] == pytest.approx([200 * 0.995, 200 * 0.998], abs=0.02)


def test_a_homed_machine_is_at_home_at_home(printer: Printer) -> None:
    drive = Drive(pulley=EccentricBore(1.0, 0.3), belt=Play(0.7))
    mechanism = Corruption((drive, drive), CrookedFrame(skew_deg=1.0)).lower(printer).homed()
    home = np.array(printer.home_mm)
    motors = printer.to_motor(home)
    engaged = []
    for motor, table in enumerate(mechanism.transmissions):
        lower, upper = table.branches_mm(motors[motor])
        engaged.append(float(lower if printer.motor_home_direction(motor) > 0 else upper))
    np.testing.assert_allclose(mechanism.frame.apply(printer.from_motor(np.array(engaged))), home, atol=1e-9)


@pytest.mark.parametrize(
    "make",
    [
        lambda: WrongRadius(-1.0),
        lambda: EccentricBore(7.0, radius_mm=6.0),
        lambda: Ellipse(math.nan, 5.0),
        lambda: Polygon((6.0, 6.0)),
        lambda: FlatSpot(7.0, radius_mm=6.0),
        lambda: FourierHull(6.0, (0.0, 0.0, 3.0), (0.0, 0.0, 0.0)),
        lambda: FourierHull(6.0, (6.5,), (0.0,)),
        lambda: TabulatedHull(tuple(6 + 2 * np.cos(5 * np.linspace(0, 6.28, 100)))),
        lambda: PublishedHull("banana"),
        lambda: Play(-0.1),
        lambda: LooseBelt(-0.1, 0.0),
        lambda: Friction(math.inf, 1e4, 600.0),
        lambda: GainTable((1.0,)),
        lambda: Corruption((Drive(gain_table=GainTable((1.0,) * 1100)), Drive())),
    ],
)
def test_impossible_values_are_refused(make) -> None:
    with pytest.raises(ConfigError, match=r"expected .*, found .*; "):
        make()


def test_an_over_tight_loose_belt_is_refused(ender5: Printer) -> None:
    with pytest.raises(ConfigError, match="negative play"):
        lowered(Drive(pulley=EccentricBore(1.0), belt=LooseBelt(0.1, 0.1)), ender5)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[[effect]]\nname = 'play'\non = ['x']", "'x'"),
        ("effect = 3", r"\[\[effect\]\]"),
        ("[[effect]]\nsize_mm = 3", "name in"),
        ("[[effect]]\nname = 'racking'\nsize = 3", "broken.toml, effect 'racking'.*'size'"),
        ("[x.pulley]\nkind = 'round'", "kind"),
        ("[x.pulley]\nkind = 'eccentric'\nsize = 2", "size"),
        ("[x.pulley]\nkind = 'eccentric'", "eccentricity_mm"),
        ("[x.belt]\nkind = 'play'\nplay_mm = -1", r"\[x.belt\].*play_mm"),
        ("[x.belt]\nkind = 'play'\nplay_mm = [1]", "play_mm"),
        ("[x.motor]\nkind = 'play'", "motor"),
        ("[q.belt]\nkind = 'play'", "'q'"),
        ("[x.belt]\nkind='play'\nplay_mm=1\n[a.belt]\nkind='play'\nplay_mm=1", "both namings"),
        ("x = 3", r"\[x.pulley\]"),
        ("[x", "TOML"),
    ],
)
def test_wrong_toml_is_named(text: str, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        parse_corruption(text, subject="broken.toml")


def test_empty_toml_is_healthy() -> None:
    assert parse_corruption("", subject="empty") == HEALTHY


def test_the_papers_severity_is_damaged_but_for_its_pulleys() -> None:
    drawn = [sample("pulley", np.random.default_rng(seed), "paper") for seed in range(60)]
    kinds = {type(drive.pulley).__name__ for corruption in drawn for drive in corruption.drives}
    assert kinds == {"WrongRadius", "PublishedHull"}
    for family in ("play", "frame", "friction", "set-screw"):
        one, other = (sample(family, np.random.default_rng(4), severity) for severity in ("paper", "damaged"))
        assert one == other
    with pytest.raises(ConfigError, match="damaged, realistic or paper"):
        sample("play", np.random.default_rng(4), "worn")  # type: ignore[arg-type]


def test_what_wears_goes_on_in_the_next_print() -> None:
    """After one print, all of the play that came loose in it is there from its first row on."""
    ender3 = read_printer("ender3")
    path = np.array([[0.0, 0.0], [100.0, 50.0], [50.0, 100.0], [100.0, 50.0], [20.0, 20.0]])
    worn = Twin.of(corruption_of(["wear:on=x,size_mm=0.4", "drift:on=y,size_mm=0.3"]), ender3)
    again, way = worn.again().follow(path) - path, np.array([1.0, -1.0, 1.0, -1.0])
    done = 1.0 + np.cumsum(np.hypot(*np.diff(path, axis=0).T)) / np.hypot(*np.diff(path, axis=0).T).sum()
    np.testing.assert_allclose(again[1:, 0], -0.2 * way * done, atol=1e-9)
    assert not again[:, 1].any()
