"""A corruption that names an effect, its place and its numbers; numbers that are left out are drawn from its prior.

    racking:on=x,size_mm=0.3            splice:at_mm=120,size_mm=0.7,on=y            wear

The motors are x and y, or a and b on a CoreXY, where x and y are the axes of the bed. Every effect in `EFFECTS` can be
named, including those of other packages, and every event of a print (`event`). `listing` returns them all, each with
a line about it and an example.
"""

import inspect
import math
import zlib
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from typing import Any, Literal, NoReturn

import numpy as np

from printmend.corruption.event import EVENTS, Made
from printmend.effects import EFFECTS, Acts, Scene, title_of
from printmend.effects.effect import Effect, Term, drawn_term, terms_of
from printmend.effects.sized import Sized, belts_mm, scene_of_printer
from printmend.effects.words import AXES, Keys, keys_of, limits_of
from printmend.errors import ConfigError
from printmend.filament import check_name
from printmend.machine import healthy_transmission
from printmend.messages import say
from printmend.printer import Printer, read_printer
from printmend.printer.printer import SWITCHES

STEEPEST = -0.95  # limit of a belt error's slope: at −1 the belt would stand still
REALISTIC_SHARE = 0.12  # sizes on a well-kept machine, as a share of those on a damaged one
_MOTORS, _BED_AXES = {"x": 0, "y": 1, "a": 0, "b": 1}, {"x": 2, "y": 3}
_LISTED = ("ender3", "corexy")  # together, these printers have every effect
_TODO = say("terminal-printmend-twin-list-shows-every-effect")


@dataclass(frozen=True)
class Cause:
    """An effect by its name, ``on`` a motor or axis, with its ``values`` by key; the rest is drawn from ``seed``."""

    effect: str
    on: str | None = None
    values: tuple[tuple[str, float | str], ...] = ()
    seed: int = 0
    severity: Literal["damaged", "realistic"] = "damaged"
    kind = "effect"

    def __post_init__(self) -> None:
        event = EVENTS.get(self.effect)
        if event is None and self.effect not in EFFECTS:
            near = get_close_matches(self.effect, (*EFFECTS, *EVENTS), 3)
            raise ConfigError(
                say("subject-effect", repr(self.effect)), wanted=say("name-effect"), came=say("no-such-name"),
                todo=say("did-you-mean-else", ', '.join(near), _TODO) if near else _TODO,
            )  # fmt: skip
        if self.on is not None and not (isinstance(self.on, str) and self.on in _MOTORS):
            self._refuse(say("x-y-b"), repr(self.on))
        if not isinstance(self.seed, int) or isinstance(self.seed, bool) or self.seed < 0:
            self._refuse(say("seed-whole-number-from-0"), repr(self.seed))
        if self.severity not in ("damaged", "realistic"):
            self._refuse(say("severity-damaged-realistic"), repr(self.severity))
        object.__setattr__(self, "values", tuple(sorted(self.values)))
        if event is not None:
            self._check_event()
            return
        keys = named_keys(EFFECTS[self.effect])
        for name, value in self.values:
            if name not in keys.names:
                self._refuse(say("keys-out-seed-severity", ", ".join(keys.names)), repr(name))
            self._check(keys, name, value)

    def _check_event(self) -> None:
        event = EVENTS[self.effect]
        if self.on is not None and not event.has_motors:
            self._refuse(say("no-effect-whole-machine"), repr(self.on))
        if self.severity != "damaged":
            self._refuse(say("keys-of-event", ", ".join(event.names)), "severity")
        for name, value in self.values:
            if name not in event.names:
                self._refuse(say("keys-of-event", ", ".join(event.names)), repr(name))
            elif name not in event.words:
                self._check_number(name, value)
            elif name == "polymer":
                check_name(str(value))
            elif value not in SWITCHES:
                self._refuse(say("homing-switch", ", ".join(SWITCHES)), repr(value))
            if name == "teeth" and float(value) % 1.0:
                self._refuse(say("whole-number-of-teeth"), repr(value))

    def _check_number(self, name: str, value: object) -> None:
        low, high, _ = limits_of(name)
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not number or not low <= float(value) <= high:  # type: ignore[arg-type]
            self._refuse(say("within", name, f"{low:g}", f"{high:g}"), repr(value))

    def _check(self, keys: Keys, name: str, value: object) -> None:
        if name == "axis":
            if value not in tuple(AXES):
                self._refuse(say("axis-x-y"), repr(value))
            return
        self._check_number(name, value)
        if name == "harmonic" and value not in getattr(keys, "harmonics", ()):
            self._refuse(say("harmonic-out", ", ".join(map(str, keys.harmonics))), repr(value))  # type: ignore[attr-defined]

    def made(self, printer: Printer) -> Made:
        """Return the changes that it makes to a printer. Raise `ConfigError` if the two do not fit."""
        event = EVENTS.get(self.effect)
        if event is None:
            return Made((self.part(printer),))
        motor = None if self.on is None else _MOTORS[self.on]
        return event.made(dict(self.values), motor, printer, self._rng())

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng((self.seed, zlib.crc32(self.effect.encode())))

    def part(self, printer: Printer) -> Sized:
        """Return the effect with its shape and sizes on a printer. Raise `ConfigError` if the two do not fit."""
        return _part(self, printer)

    def _part(self, printer: Printer) -> Sized:
        scene, effect = scene_of_printer(printer), EFFECTS[self.effect]
        rng = self._rng()
        terms = self._terms(terms_of(effect, scene), printer)
        where = sorted({term.where for term in terms})
        place = where[int(rng.integers(len(where)))]
        alike = [term for term in terms if term.where == place]
        term, sizes = drawn_term(alike, rng)
        if self.severity == "realistic":
            sizes = sizes * REALISTIC_SHARE
        drawn, given = Sized(self.effect, term.where, term.shape, sizes), dict(self.values)
        keys = keys_of(effect, len(term.shape), len(sizes))
        part = keys.filled(given, drawn, effect, scene)
        if all(each.sign > 0 for each in alike) and part.sizes_mm.min() < 0:
            self._refuse(say("sizes-0-more-has-no-other"), f"{part.sizes_mm.min():g}")
        steepest = _steepest(part, scene)
        if steepest < STEEPEST:
            if given.keys() - set(getattr(keys, "shape", ())):
                self._refuse(say("size-which-belt-still-moves-forwards"), say("slope", f"{steepest:.2f}"))
            part = part.of(sizes_mm=part.sizes_mm * STEEPEST / steepest)
        return part

    def _terms(self, terms: list[Term], printer: Printer) -> list[Term]:
        """Return the terms of this cause's motor or axis, or all of them if it names none."""
        if not terms:
            self._refuse(say("effect-can-have", printer.name), say("cannot-have"))
        if self.on is None:
            return terms
        where = {term.where for term in terms}
        bed = _BED_AXES.get(self.on)
        wanted = bed if bed in where else _MOTORS[self.on]
        found = [term for term in terms if term.where == wanted]
        if not found or len(where) == 1:
            self._refuse(say("no-effect-whole-machine"), repr(self.on))
        return found

    def _refuse(self, wanted: str, came: str) -> NoReturn:
        raise ConfigError(say("subject-effect", repr(self.effect)), wanted=wanted, came=came, todo=_TODO)

    def table(self) -> dict[str, Any]:
        """Return the cause as a plain table, with only the given values."""
        said: dict[str, Any] = {"name": self.effect} | ({} if self.on is None else {"on": self.on}) | dict(self.values)
        said |= {"seed": self.seed} if self.seed else {}
        return said | ({} if self.severity == "damaged" else {"severity": self.severity})


@lru_cache(maxsize=64)
def _part(cause: Cause, printer: Printer) -> Sized:
    return cause._part(printer)


def cause_of(text: str, *, seed: int = 0) -> Cause:
    """Parse a text such as ``racking:on=x,size_mm=0.3``; ``seed`` draws the numbers that it leaves out."""
    name, _, rest = text.partition(":")
    table: dict[str, Any] = {"seed": seed}
    for item in filter(None, rest.split(",")):
        key, equals, value = item.partition("=")
        if not equals:
            raise ConfigError(text, wanted=say("keys-key-value-commas-between"), came=repr(item), todo=_TODO)
        if key.strip() in table.keys() - {"seed"}:
            raise ConfigError(
                text, wanted=say("each-key-once"), came=say("twice", key.strip()), todo=say("remove-one-them")
            )
        table[key.strip()] = _plain(value.strip())
    return cause_from(name.strip(), table)


def cause_from(name: str, table: dict[str, Any]) -> Cause:
    """Return an effect from its name and a plain table of its keys."""
    values = dict(table)
    own = {key: values.pop(key) for key in ("on", "seed", "severity") if key in values}
    return Cause(name, values=tuple(values.items()), **own)


def _plain(text: str) -> float | str:
    try:
        return int(text)
    except ValueError:
        try:
            return float(text)
        except ValueError:
            return text


def offered(effect: Effect) -> list[Term]:
    """Return an effect's terms on the first printer that has it."""
    each = (terms_of(effect, scene_of_printer(read_printer(name))) for name in _LISTED)
    return next((terms for terms in each if terms), [])


def named_keys(effect: Effect) -> Keys:
    """Return the keys of an effect, its own ones or those that `keys_of` gives it."""
    if (named := getattr(effect, "keys", None)) is not None:
        return named  # type: ignore[no-any-return]
    terms = offered(effect)
    return keys_of(effect, len(terms[0].shape) if terms else 0, len(terms[0].sd_mm) if terms else 1)


def _steepest(part: Sized, scene: Scene) -> float:
    """Return the most negative slope of the belt error that a part makes over the bed; 0 if it belongs to no drive."""
    if not part.is_held or EFFECTS[part.effect].acts is not Acts.DRIVE:
        return 0.0
    places, (low, high) = healthy_transmission(scene.printer, part.where).motor_mm, scene.motor_span_mm[part.where]
    places = places[(places >= low) & (places <= high)]
    return min(float((np.diff(belt) / np.diff(places)).min()) for belt in belts_mm(scene, part.where, [part], places))


MOST_SHOWN = 2  # sizes in an example


def listing() -> list[tuple[str, str, str]]:
    """Return the name of each effect and event, a line about it, and an example of a text for `cause_of`."""
    effects = [(name, said(effect), example_of(name)) for name, effect in EFFECTS.items()]
    return effects + [(name, event.said, event.example) for name, event in EVENTS.items()]


def said(effect: Effect) -> str:
    """Return what an owner calls an effect, or the first sentence of the docstring of another package's."""
    paragraph = (inspect.getdoc(type(effect)) or effect.name).partition("\n\n")[0]
    return title_of(effect.name) or " ".join(paragraph.split()).partition(". ")[0].rstrip(".:")


def example_of(name: str) -> str:
    """Return a text for `cause_of`: an effect with one of the shapes that its terms have."""
    effect = EFFECTS[name]
    keys, terms = named_keys(effect), offered(effect)
    items = ["on=x"] if len({term.where for term in terms}) > 1 else []
    terms = [term for term in terms if term.where == terms[0].where]
    shape = typical_shape(keys, terms)
    sizes = [key for key in keys.names if key not in shape and key not in ("phase_rad", "harmonic")]
    for key, value in shape.items():
        items.append(f"{key}={AXES[int(value)] if key == 'axis' else format(value, '.3g')}")
    room_mm = shape.get("period_mm", math.inf) / 20  # with a larger wave the belt might move backwards
    items += [f"{key}={min(limits_of(key)[2], room_mm):.3g}" for key in sizes[:MOST_SHOWN]]
    return f"{name}:{','.join(items)}"


def typical_shape(keys: Keys, terms: list[Term]) -> dict[str, float]:
    """Return the numbers of a typical shape of an effect, by their keys."""
    return dict(zip(getattr(keys, "shape", ()), terms[len(terms) // 4].shape if terms else (), strict=False))
