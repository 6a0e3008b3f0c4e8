"""What printmend says, by id: a message is an id with values, and `de.po` has its English and German side by side.

    raise ScanError(path, wanted=say("some-marks", least, count), came=say("few-marks", found), todo=say("scan-whole"))

`say` returns a `Said`: the English text, which remembers its id and values. Whoever shows texts in another language
takes these along (`messages_of`) and looks the id up (`translated`). `together` puts texts together and remembers them.
"""

import json
import re
import string
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from importlib import resources
from typing import Any

ENGLISH, GERMAN = "en", "de"
Tell = Callable[[str], str]  # puts a message into the reader's language
_DEEPEST = 8  # messages within messages
# Numbers that a German reader gets with a comma: no version of a program among them.
_NUMBERS = re.compile(r"(?!.*\d\.\d+\.)[\s\d.±+–−-]*\d\.\d[\s\d.±+–−-]*( ?[%°a-z]+)?")
_NEGATIVE = re.compile(r"^-(?=\d+(\.\d+)?( ?[%°±]|$| mm))")
_LINE = re.compile(r'^(msg\S+) "(.*)"$', re.MULTILINE)  # of an entry of a .po file
_AFTER_SEMICOLON = re.compile(r"; (Der|Die|Das|Ein|Eine|Es|Alle|Jede)\b")
PAGE = "/page"  # ends the id of a message that a page words differently: the terminal's names a command or an option
HELP = "help"  # the context of what --help says
MANY = "/many"  # ends the id of a message's plural


class Said(str):
    """A message in English that knows its ``id`` and its ``values``, texts or messages themselves.

    ``texts`` are its English and German where the catalogue does not have its id: those of an effect from outside.
    """

    id: str
    values: dict[str, str]
    texts: tuple[str, str] | None = None

    def replace(self, old: str, new: str, /, *count: Any) -> "Said":
        """Return the message with the text ``new`` in place of ``old``, in its values too."""
        values = {name: value.replace(old, new) for name, value in self.values.items()}
        return said(self.id, values, str(self).replace(old, new), self.texts)

    def __reduce__(self) -> tuple[Any, ...]:
        return said, (self.id, self.values, str(self), self.texts)


def said(name: str, values: dict[str, str], english: str, texts: tuple[str, str] | None = None) -> Said:
    """Return an English text as the message of an id."""
    text = Said(english)
    text.id, text.values, text.texts = name, values, texts
    return text


def say(name: str, *values: object) -> Said:
    """Return the message of an id; ``values`` fill its places {a}, {b}, …. Raises `KeyError` for an unknown id."""
    filled = places_of(values)
    return said(name, filled, catalogue()[name][0].format(**filled))


def say_count(name: str, number: int, *values: object) -> Said:
    """Return the message of an id in its singular or plural; ``number`` fills {a}, ``values`` {b}, {c}, …

    English and German have the same rule: one is singular, every other number plural.
    """
    return say(name if number == 1 else name + MANY, number, *values)


def say_large(share: float) -> Said:
    """Say by how many % something is too large, or for a ``share`` below 0 too small."""
    percent = round(100 * share, 2)
    return say("percent-too-small" if percent < 0 else "percent-too-large", f"{abs(percent):.2f}")


def say_own(texts: tuple[str, str], *values: object) -> Said:
    """Return a message that is not in the catalogue, from its English and German."""
    filled = places_of(values)
    return said(texts[0], filled, texts[0].format(**filled), texts)


def places_of(values: Iterable[object]) -> dict[str, str]:
    """Return values by the places that they fill, a, b, …; a number below 0 gets a minus sign in place of a hyphen."""
    filled = (value if isinstance(value, Said) else _signed(str(value)) for value in values)
    return dict(zip(string.ascii_lowercase, filled, strict=False))


def together(between: str, parts: Iterable[str]) -> Said:
    """Return texts one after the other, with the text ``between`` them; one message stays as it is."""
    values = {str(place): part for place, part in enumerate(parts)}
    if len(values) == 1 and isinstance(values["0"], Said):
        return values["0"]
    return said(between, values, between.join(values.values()))


def is_one_of(text: str, names: Iterable[str]) -> bool:
    """Tell whether a text is the message of one of these ids."""
    return isinstance(text, Said) and text.id in names


def translated(text: str, language: str) -> str:
    """Return a message in a language; a text without an id stays as it is, except that a number gets a minus sign, and
    in German a comma."""
    text = text if isinstance(text, Said) else _signed(text)
    return _value(text) if language == GERMAN else str(text)


def as_lines(text: str, language: str) -> str:
    """Return a message in a language as lines of their own: each begins with a capital, unless with a name."""
    if isinstance(text, Said) and text.id.startswith("\n"):
        return text.id.join(as_lines(part, language) for part in text.values.values())
    words = translated(text, language)
    return words[:1].upper() + words[1:] if _begins_with_words(text) else words


def _begins_with_words(text: str) -> bool:
    """Tell a message that begins with words of its own from one that begins with a value, such as a file's name."""
    if not isinstance(text, Said):
        return False
    template = (catalogue().get(text.id) or text.texts or ("{0}",))[0]
    first = re.match(r"{(\w+)}", template)
    return first is None or _begins_with_words(text.values.get(first[1], ""))


def tell_in(language: str) -> Tell:
    """Return what puts messages into a language."""
    return lambda text: translated(text, language)


def _signed(text: str) -> str:
    """Return a text that begins with a number below 0 with a minus sign in place of the hyphen."""
    return _NEGATIVE.sub("−", text)


def _german(text: str) -> str:
    if not isinstance(text, Said):
        return text
    values = {name: _value(value) for name, value in text.values.items()}
    german = (catalogue().get(text.id) or text.texts or ("", ""))[1]
    if german:
        return german.format(**values)
    return _AFTER_SEMICOLON.sub(lambda found: found[0].lower(), text.id.join(values.values()))


def _value(text: str) -> str:
    """Return a message, or what fills one of its places, in German: numbers get a comma."""
    if isinstance(text, Said):
        return _german(text)
    return text.replace(".", ",") if _NUMBERS.fullmatch(text) else text


def parts_of(text: str) -> Iterator[Said]:
    """Yield a message, and the messages within it."""
    if isinstance(text, Said):
        yield text
        for value in text.values.values():
            yield from parts_of(value)


def within(sentence: str) -> str:
    """Return a sentence as a part of another: it begins with a small letter."""
    lowered = sentence[:1].lower() + sentence[1:]
    return said(sentence.id, sentence.values, lowered) if isinstance(sentence, Said) else lowered


def messages_of(value: Any) -> dict[str, Any]:
    """Return the ids and values of all messages in plain data, by their English text: what to send along with it."""
    found: dict[str, Any] = {}
    _gather(value, found)
    return found


def restored(value: Any, messages: Mapping[str, Any]) -> Any:
    """Return plain data whose texts are again the messages that `messages_of` told of."""
    if isinstance(value, str):
        return _restored(value, messages, _DEEPEST)
    if isinstance(value, Mapping):
        return {key: restored(item, messages) for key, item in value.items()}
    if isinstance(value, list) and any(isinstance(item, str | list | dict) for item in value[:1]):
        return [restored(item, messages) for item in value]
    return value


def page_messages() -> dict[str, dict[str, str]]:
    """Return every message as a page says it in English and in German, by its id."""
    found = {name: {"en": english, "de": german} for name, (english, german) in catalogue().items()}
    return {name: found.get(name + PAGE, texts) for name, texts in found.items() if not name.endswith(PAGE)}


@cache
def help_words() -> dict[str, str]:
    """Return the German of what --help says, by its English: those texts stand in the commands, and need no id."""
    return {entry["msgid"]: entry["msgstr"] for entry in _entries() if entry["msgctxt"] == HELP}


@cache
def catalogue() -> dict[str, tuple[str, str]]:
    """Return every message's English and German by its id."""
    found = {}
    for entry in _entries():
        name = entry["msgctxt"]
        if "msgid_plural" in entry:
            found[name] = entry["msgid"], entry["msgstr[0]"]
            found[name + MANY] = entry["msgid_plural"], entry["msgstr[1]"]
        elif name != HELP:
            found[name] = entry["msgid"], entry["msgstr"]
    return found


@cache
def _entries() -> list[dict[str, str]]:
    """Return the catalogue's entries, each by its keywords; the first entry of a .po file is its header."""
    text = resources.files(__name__).joinpath("de.po").read_text(encoding="utf-8")
    whole = text.replace('"\n"', "")  # a text goes on in the next line
    _, *entries = [{key: _unescaped(value) for key, value in _LINE.findall(each)} for each in whole.split("\n\n")]
    return entries


def _unescaped(value: str) -> str:
    return json.loads(f'"{value}"') if "\\" in value else value


def _gather(value: Any, found: dict[str, Any]) -> None:
    if isinstance(value, Said):
        _gather(value.values, found)
        found[str(value)] = {"id": value.id, "values": dict(value.values)}
        if value.texts is not None:
            found[str(value)]["texts"] = list(value.texts)
    elif isinstance(value, Mapping):
        for item in value.values():
            _gather(item, found)
    elif isinstance(value, list | tuple):
        for item in value:
            if type(item) is not float:  # of a table there may be many thousands
                _gather(item, found)


def _restored(text: str, messages: Mapping[str, Any], deep: int) -> str:
    """Return a text as the message that it was; what a foreign file tells of it need not make sense."""
    told = messages.get(text)
    if not deep or not isinstance(told, Mapping) or not isinstance(told.get("values"), Mapping):
        return text
    values = {str(name): _restored(str(part), messages, deep - 1) for name, part in told["values"].items()}
    texts = told.get("texts")
    own = (str(texts[0]), str(texts[1])) if isinstance(texts, list) and len(texts) == 2 else None
    return said(str(told.get("id")), values, text, own)
