"""Which printer a name means: the names that slicers and owners give to printers on the market."""

import re
from functools import cache
from itertools import product


def _of_sizes(words: str, *beds_mm: int) -> tuple[str, ...]:
    """Return the printers of one model in several sizes: without its size, its words mean any of them."""
    return tuple(f"{' | '.join(f'{word} {bed_mm}' for word in words.split(' | '))} | {words}" for bed_mm in beds_mm)


# By the words for their maker: printers that differ in bed, kinematics or motors, each with the words for it. A space
# stands for any separator or none. An upgrade that keeps the belts and the bed is the same printer (Ender-3, Pro, V2).
_MADE = {
    "anycubic": (
        "i3 mega | mega s | mega pro", "mega x", "mega zero | mega 0", "4 max", "chiron", "vyper", "kobra | kobra neo",
        "kobra 2", "kobra 3", "kobra go", "kobra max | kobra 2 max", "kobra plus | kobra 2 plus", "kobra s1",
    ),
    "artillery": (
        "sidewinder | sidewinder x1 | sidewinder x2 | x1 | x2", "sidewinder x3", "sidewinder x4", "genius", "hornet",
    ),
    "bambu lab | bambu | bbl": (
        "p1p | p1s", "p2s", "x1 | x1c | x1 carbon | x1e", "a1", "a1 mini", "h2d", "h2s", "h2c",
    ),
    "creality | ender": (
        "ender 2", "ender 3 | ender 3 v3 se", "ender 3 v3 ke", "ender 3 max | ender 3 max neo", "ender 3 s1 plus",
        "ender 3 v3", "ender 3 v3 plus", "ender 4", "ender 5", "ender 5 plus", "ender 5 max", "ender 6", "ender 7",
        "cr 5", "cr 6 | cr 6 se", "cr 6 max", "cr 8", "cr 10", "cr 10 mini", "cr 10 se", "cr 10 max", "cr 10 s4",
        "cr 10 s5", "cr 20", "cr 200b", "cr m4", "k1 | k1c | k1 se", "k1 max", "k2", "k2 plus", "sermoon",
    ),
    "elegoo": (
        "neptune 1", "neptune 2", "neptune 3", "neptune 3 plus", "neptune 3 max", "neptune 4", "neptune 4 plus",
        "neptune 4 max", "neptune x", "centauri",
    ),
    "kingroon": ("kp3s", "kp3s pro", "klp1"),
    "lulzbot": ("taz 6", "taz 5", "taz pro", "taz workhorse", "mini"),
    "prusa": (
        "mk2", "mk3 | mk3 5", "mk4 | mk3 9", "mini | mini is", "xl | xl2 | xl5", "core one", "core one l",
    ),
    "qidi": (
        "q1 pro", "q2", "x smart 3", "x plus 3", "x plus 4", "x max 3", "x cf pro", "max 4",
    ),
    "rat rig": (
        *_of_sizes("v core 3 | v core 3 1", 200, 300, 400, 500), *_of_sizes("v core 4", 300, 400, 500), "v minion",
    ),
    "sovol": ("sv01", "sv02", "sv03", "sv04", "sv05", "sv06", "sv06 plus", "sv07", "sv07 plus", "sv08"),
    "two trees": ("sapphire plus", "sapphire pro", "bluer", "sp 3", "sp 5"),
    "voron": (
        "voron 0 | v0", "voron 1 | v1", *_of_sizes("voron 2 | v2 | voron 2 4 | v2 4", 250, 300, 350),
        *_of_sizes("trident", 250, 300, 350), "switchwire | voron switchwire",
    ),
    "voxelab": ("aquila", "aries"),
    "anet": (), "ankermake": (), "biqu": (), "flashforge": (), "flsun": (), "geeetech": (), "makerbot": (),
    "raise3d": (), "snapmaker": (), "tronxy": (), "ultimaker": (), "wanhao": (),
}  # fmt: skip
_OF_ANY_MAKER = "prusai3"  # the clones of many makers are called so
_LEAST_LETTERS = 3  # of a word with a digit that says by itself which printer it is, as P1S does


def printers_named(name: str) -> frozenset[str]:
    """Return the printers that a name may mean, by the first of their words; none where it names none that is known.

    A maker's name without a model's means any of its printers. Words without a digit (Mini) may be anybody's: they
    count as the whole name, or behind their maker's.
    """
    words, makers, pattern = _known()
    if (whole := words.get(bare_name(name))) is not None:
        return whole
    found = [bare_name(each[0]) for each in pattern.finditer(_of_file(name).lower())]
    models = [words[each] for each in found if each in words]
    return frozenset[str]().union(*(models or [makers[each] for each in found]))


@cache
def _known() -> tuple[dict[str, frozenset[str]], dict[str, frozenset[str]], re.Pattern[str]]:
    """Return the printers by their words, the printers by their makers, and what finds either in a name."""
    words: dict[str, frozenset[str]] = {}
    makers: dict[str, frozenset[str]] = {_OF_ANY_MAKER: frozenset()}
    patterns = {_OF_ANY_MAKER: _pattern("prusa i3")}
    for maker, printers in _MADE.items():
        calls, names = maker.split(" | "), [each.split(" | ") for each in printers]
        for call in calls:
            makers[bare_name(call)] = frozenset([calls[0], *(f"{calls[0]} {each[0]}" for each in names)])
            patterns[bare_name(call)] = _pattern(call)
        for each in names:
            for call, word in product(("", *calls), each):
                said = f"{call} {word}".strip()
                key = bare_name(said)
                words[key] = words.get(key, frozenset()) | {f"{calls[0]} {each[0]}"}
                if call or (len(key) >= _LEAST_LETTERS and any(c.isdigit() for c in key)):
                    patterns[key] = _pattern(said)
    longest_first = sorted(patterns, key=len, reverse=True)
    return words, makers, re.compile(rf"(?<![^\W_])(?:{'|'.join(patterns[each] for each in longest_first)})")


def _pattern(word: str) -> str:
    """Return what finds a word that no digit follows, nor a letter where it ends with one."""
    return r"[\W_]*".join(word.split()) + (r"(?!\d)" if word[-1].isdigit() else r"(?![^\W_])")


def bare_name(name: str) -> str:
    """Return a printer's name in small letters and digits; one without a name goes by its file's."""
    return "".join(each for each in _of_file(name).lower() if each.isalnum())


def _of_file(name: str) -> str:
    return name.replace("\\", "/").rpartition("/")[2] if name.endswith(".toml") else name
