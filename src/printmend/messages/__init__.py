"""What printmend says, by id: a message is an id with values, and `de.po` has its English and German side by side.

    raise ScanError(path, wanted=say("some-marks", least, count), came=say("few-marks", found), todo=say("scan-whole"))

`say` returns a `Said`: the English text, which remembers its id and values. Whoever shows texts in another language
takes these along (`messages_of`) and looks the id up. `together` puts texts together and remembers them.
"""

import string
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import resources
from typing import Any

import polib

_DEEPEST = 4  # messages within messages
PAGE = "/page"  # ends the id of a message that a page says otherwise, where the terminal's names a command or an option


class Said(str):
    """A message in English that knows its ``id`` and its ``values``, texts or messages themselves."""

    id: str
    values: dict[str, str]

    def replace(self, old: str, new: str, /, *count: Any) -> "Said":
        """Return the message with the text ``new`` in place of ``old``, in its values too."""
        values = {name: value.replace(old, new) for name, value in self.values.items()}
        return said(self.id, values, str(self).replace(old, new))

    def __reduce__(self) -> tuple[Any, ...]:
        return said, (self.id, self.values, str(self))


def said(name: str, values: dict[str, str], english: str) -> Said:
    """Return an English text as the message of an id."""
    text = Said(english)
    text.id, text.values = name, values
    return text


def say(name: str, *values: object) -> Said:
    """Return the message of an id; ``values`` fill its places {a}, {b}, …. Raises `KeyError` for an unknown id."""
    english = catalogue()[name][0]
    filled = {
        place: value if isinstance(value, Said) else str(value)
        for place, value in zip(string.ascii_lowercase, values, strict=False)
    }
    return said(name, filled, english.format(**filled))


def together(between: str, parts: Iterable[str]) -> Said:
    """Return texts one after the other, with the text ``between`` them."""
    values = dict(zip(string.ascii_letters, parts, strict=False))
    return said(between, values, between.join(values.values()))


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
def catalogue() -> dict[str, tuple[str, str]]:
    """Return every message's English and German by its id."""
    text = resources.files(__name__).joinpath("de.po").read_text(encoding="utf-8")
    return {entry.msgctxt: (entry.msgid, entry.msgstr) for entry in polib.pofile(text)}


def _gather(value: Any, found: dict[str, Any]) -> None:
    if isinstance(value, Said):
        _gather(value.values, found)
        found[str(value)] = {"id": value.id, "values": dict(value.values)}
    elif isinstance(value, Mapping):
        for item in value.values():
            _gather(item, found)
    elif isinstance(value, list | tuple):
        for item in value:
            _gather(item, found)


def _restored(text: str, messages: Mapping[str, Any], deep: int) -> str:
    """Return a text as the message that it was; what a foreign file tells of it need not make sense."""
    told = messages.get(text)
    if not deep or not isinstance(told, Mapping) or not isinstance(told.get("values"), Mapping):
        return text
    values = {str(name): _restored(str(part), messages, deep - 1) for name, part in told["values"].items()}
    return said(str(told.get("id")), values, text)
