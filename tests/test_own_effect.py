"""An effect of one's own, from outside the package, as docs/adding_an_effect.md tells it: learned, named, mended."""

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from printmend import effects, plugins
from printmend.diagnosis.advice import advise
from printmend.diagnosis.named import faults_of, misfits_of
from printmend.effects import EFFECTS, Acts, Effect, Of, Places, Scene, Term, scene_of
from printmend.effects.effect import about, onto_bed
from printmend.effects.prior import alternatives
from printmend.effects.words import Care, Fault, Found, Message, amount, motor_name
from printmend.errors import ConfigError
from printmend.infer.fit import fitted
from printmend.infer.machine import Sized, machine_of
from printmend.infer.posterior import posterior_of
from printmend.machine import healthy_mechanism
from printmend.machine.printing import print_from_home
from printmend.path import Trace
from printmend.printer import Printer, read_printer

AT_MM = 3.0  # distance of the places that are tried
WIDTHS_MM = (3.0, 5.2, 9.0)
TITLE = Message("{a} belt is kinked", "Der Riemen von {a} ist geknickt")
MEANING = Message(
    "About one place along {a} lines swing by {b} mm.", "Um eine Stelle längs {a} schwingen Linien um {b} mm."
)


class Kink:
    """A belt that climbs over a kink: it is ahead about one place, over a width, and nowhere else."""

    name = "kink"
    of = Of.MACHINE
    acts = Acts.DRIVE
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            low, high = scene.motor_span_mm[motor]
            shapes = [(float(at), float(width)) for at in np.arange(low, high, AT_MM) for width in WIDTHS_MM]
            yield from alternatives(self.name, motor, shapes, (1.0,), share=0.01, sd_mm=0.3)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        bump = np.exp(-0.5 * ((places.motor_mm[:, [where]] - at) / width) ** 2)
        return onto_bed(scene, where, bump)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        at, width = shape
        for place in about(at, AT_MM, round_):
            yield float(place), width
        for factor in about(0.0, 0.5, round_):
            yield at, float(width * np.exp(factor))

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        size, sd = found.size(lambda sizes: float(sizes[0]))
        words = f"kinked belt at {found.shape[0]:.0f} mm, {amount(size, sd)}"
        yield Fault(motor_name(scene, found.where), self.name, size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care | None:
        if fault.kind != self.name:
            return None
        return Care(TITLE(where), MEANING(where, f"{abs(fault.value):.2f}"), abs(fault.value), "Replace the belt.")


@pytest.fixture
def kink(monkeypatch: pytest.MonkeyPatch) -> Kink:
    one: Effect = Kink()
    monkeypatch.setitem(EFFECTS, one.name, one)
    return Kink()


def walk(printer: Printer, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return way-points [N, 2] from home over the bed, reached from all sides by short and by long moves."""
    low, high = (np.array([getattr(axis, end) for axis in printer.axes[:2]]) for end in ("min_mm", "max_mm"))
    far = rng.uniform(low + 10, high - 10, (count // 3, 2))
    near = far[:, None, :] + np.concatenate([np.zeros((1, 2)), rng.uniform(-4, 4, (2, 2))])
    return np.vstack([np.array(printer.home_mm)[None], near.reshape(-1, 2)])


def printed(mechanism: object, path: np.ndarray, printer: Printer) -> np.ndarray:
    """Return where a machine prints way-points [N, 2]."""
    high = np.full((len(path), 1), printer.z.home_mm)
    return np.asarray(print_from_home(mechanism, np.hstack([path, high])))[:, :2]  # type: ignore[arg-type]


def test_an_effect_of_ones_own_is_learned_named_and_mended(kink: Kink) -> None:
    printer, rng = read_printer("ender3"), np.random.default_rng(5)
    path = walk(printer, rng, 450)
    turns = (printer.axes[0].mm_per_turn, printer.axes[1].mm_per_turn)
    plain = Trace(path, path.copy(), homed=True)
    scene = scene_of(plain, printer, turns)
    at = scene.motor_middle_mm(0) + 21.0
    true, _ = machine_of(scene, [Sized("kink", 0, (at, 5.5), np.array([0.2])), Sized("play", 1, (), np.array([0.15]))])
    places = printed(true, path, printer)
    trace = Trace(path, places + rng.normal(0, 0.02, places.shape), homed=True)

    fit = fitted(trace, scene_of(trace, printer, turns), healthy_mechanism(printer))
    believed = posterior_of(fit, rng)
    (named,) = [fault for fault in faults_of(believed.parts, fit.scene) if fault.kind == "kink"]
    assert named.part == printer.motors[0]
    assert abs(named.value - 0.2) < 4 * named.sd + 0.01
    assert advise(named, corexy=False).title.endswith("belt is kinked")
    assert not misfits_of(believed.parts, fit.scene, believed.nats)

    fresh = walk(printer, np.random.default_rng(6), 900)
    off = printed(fit.mechanism, fresh, printer) - printed(true, fresh, printer)
    assert np.sqrt(np.mean(np.square(off).sum(axis=1))) < 0.01


def test_effects_of_other_packages_have_names_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    brought = Kink()
    monkeypatch.setattr(effects, "plugin_names", lambda group: ("ours",))
    monkeypatch.setattr(effects, "load_plugin", lambda group, name, **_: brought)
    assert effects._of_others() == {"kink": brought}
    assert plugins.EFFECTS == "printmend.effects"
    monkeypatch.setattr(Kink, "name", "play")
    with pytest.raises(ConfigError, match="a name of its own"):
        effects._of_others()
