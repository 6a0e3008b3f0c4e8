"""Messages by id: each is in the catalogue in both languages, and is known by its id wherever it is shown."""

import ast
import json
import pickle
import re
import string
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import polib
import pytest
from click.testing import CliRunner

import printmend
from printmend.cli.main import group
from printmend.cli.terminal import Terminal
from printmend.errors import InputError
from printmend.messages import (
    GERMAN,
    HELP,
    MANY,
    PAGE,
    Said,
    catalogue,
    help_words,
    messages_of,
    page_messages,
    restored,
    say,
    say_count,
    together,
    translated,
    within,
)  # fmt: skip

SOURCES = Path(printmend.__file__).parent
OPTION = re.compile(
    r"(?<!\w)--?[a-z]|printmend (?:learn|mend|measure|probe|verify|export|printer|check)|(probe|mend)\.json|trace\.csv"
)


@cache
def parsed(path: Path) -> tuple[str, list[ast.AST]]:
    """Return the text of a module and the nodes of its tree."""
    text = path.read_text(encoding="utf-8")
    return text, list(ast.walk(ast.parse(text)))


def places(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


def said_in(path: Path) -> Iterator[tuple[str, int | None, int]]:
    """Yield each id that a module says, with how many values, None where that is not written there, and its line."""
    text, nodes = parsed(path)
    for node in nodes if "from printmend.messages import" in text else ():
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("say", "say_count"):
            name, *values = node.args
            count = None if any(isinstance(value, ast.Starred) for value in values) else len(values)
            for each in (name.body, name.orelse) if isinstance(name, ast.IfExp) else (name,):
                if isinstance(each, ast.Constant):
                    yield each.value + (MANY if node.func.id == "say_count" else ""), count, node.lineno


def test_every_message_has_both_languages_with_the_same_places() -> None:
    for name, (english, german) in catalogue().items():
        assert english, name
        assert german, name
        assert places(german) <= places(english), name
        assert places(english) == set(string.ascii_lowercase[: len(places(english))]), name
        if name.endswith(PAGE):
            assert places(english) <= places(catalogue()[name.removesuffix(PAGE)][0]), name


def test_every_id_that_is_said_is_in_the_catalogue_and_the_other_way_round() -> None:
    used = set()
    for path in SOURCES.rglob("*.py"):
        for name, count, line in said_in(path):
            assert name in catalogue(), f"{path.name}:{line} says {name!r}, which messages/de.po has not"
            needed = len(places(catalogue()[name][0]))
            assert count in (None, needed) or (name.endswith(MANY) and count == needed + 1), (
                f"{path.name}:{line} {name}"
            )
        text, _ = parsed(path)
        used |= set(re.findall(r'"([a-z0-9-]+)"', text))
        for made in re.findall(r'say\(f"([a-z0-9{}_.-]+)"', text):  # an id that is put together
            used |= {name for name in catalogue() if re.fullmatch(re.sub(r"{[^}]*}", "[a-z0-9-]*", made), name)}
    unused = {name for name in catalogue() if not name.endswith((PAGE, MANY))} - used
    assert not unused, f"nothing says {sorted(unused)}"


def test_a_count_is_said_in_the_singular_or_the_plural() -> None:
    assert [say_count("so-many-layers", count) for count in (0, 1, 2)] == ["0 layers", "1 layer", "2 layers"]
    assert [translated(say_count("so-many-layers", count), "de") for count in (1, 2)] == ["1 Schicht", "2 Schichten"]
    for name in catalogue():
        if name.endswith(MANY):
            assert places(catalogue()[name.removesuffix(MANY)][0]) <= places(catalogue()[name][0]), name


def plain_words_of_errors(nodes: list[ast.AST]) -> Iterator[ast.expr]:
    """Yield what an error expects, found or advises where that is words without an id; numbers need none."""
    given = {
        (word.arg, word.value)
        for call in nodes if isinstance(call, ast.Call)
        for word in call.keywords if word.arg in ("wanted", "came", "todo")
    }  # fmt: skip
    named = {value.id for _, value in given if isinstance(value, ast.Name)}
    told = [value for _, value in given]
    for node in nodes:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in named:
            told.append(node.value)
    for value in told:
        for each in (value.body, value.orelse) if isinstance(value, ast.IfExp) else (value,):
            parts = each.values if isinstance(each, ast.JoinedStr) else [each]
            texts = [part.value for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, str)]
            if re.search(r"[a-z]{2} |[a-z]{4}", " ".join(texts)):
                yield each


def test_the_words_of_every_error_have_an_id() -> None:
    for path in SOURCES.rglob("*.py"):
        for found in plain_words_of_errors(parsed(path)[1]):
            raise AssertionError(f"{path.relative_to(SOURCES)}:{found.lineno} says {ast.unparse(found)} without an id")


def test_what_an_error_is_about_has_an_id_or_is_a_file_an_option_or_a_format() -> None:
    for path in SOURCES.rglob("*.py"):
        for node in parsed(path)[1]:
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id.endswith("Error")):
                continue
            if {"wanted", "came", "todo"} <= {word.arg for word in node.keywords} and node.args:
                about = node.args[0]
                words = (
                    "".join(
                        part.value
                        for part in ast.walk(about)
                        if isinstance(part, ast.Constant) and isinstance(part.value, str)
                    )
                    if isinstance(about, ast.JoinedStr | ast.Constant)
                    else ""
                )
                known = re.match(r"--|printmend |bgcode$|G-code$", words)
                assert known or not re.search("[a-z]{3}", words), f"{path.name}:{node.lineno} is about {words!r}"


@pytest.mark.parametrize("words", ['"a file"', 'f"{n} files"', '"none" if n else say("none")', "came"])
def test_words_without_an_id_are_seen(words: str) -> None:
    source = f'came = "some words"\nraise InputError(path, wanted={words}, came=say("none"), todo=say("rename"))'
    assert list(plain_words_of_errors(list(ast.walk(ast.parse(source)))))


def test_the_page_names_no_option_of_the_command_line() -> None:
    for name, texts in page_messages().items():
        assert name.startswith("terminal-") or not OPTION.search(texts["en"].replace("`", "")), name
        assert set(texts) == {"en", "de"}


def test_an_english_sentence_may_be_reworded_without_its_german(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "flat-scan"
    german = page_messages()[name]["de"]
    reworded = {**catalogue(), name: ("Scan all of the print", german)}
    monkeypatch.setattr("printmend.messages.catalogue", lambda: reworded)
    text = say(name)
    assert text == "Scan all of the print"
    assert messages_of(text) == {"Scan all of the print": {"id": name, "values": {}}}
    assert page_messages()[name]["de"] == german


def test_a_message_is_its_english_text_and_remembers_itself() -> None:
    text = say("marks-mm-apart-dpi", "50", 12)
    assert isinstance(text, str)
    assert text == "dots 50 mm apart at 12 dpi"
    assert (text.id, text.values) == ("marks-mm-apart-dpi", {"a": "50", "b": "12"})
    moved = text.replace("12", "13")
    assert (moved, moved.id, moved.values["b"]) == ("dots 50 mm apart at 13 dpi", "marks-mm-apart-dpi", "13")
    again = pickle.loads(pickle.dumps(text))  # noqa: S301 - our own, as a worker sends it
    assert (again, again.id, again.values) == (text, text.id, text.values)
    with pytest.raises(KeyError):
        say("no-such-id")


@pytest.mark.parametrize(
    ("text", "said"),
    [("-0.02", "−0.02"), ("-3", "−3"), ("-0.02 ± 0.01", "−0.02 ± 0.01"), ("-1.5 %", "−1.5 %"), ("-3.1°", "−3.1°"),
     ("-3-layers.gcode", "-3-layers.gcode"), ("--dpi", "--dpi"), ("2-3", "2-3"), ("+0.5", "+0.5")],
)  # fmt: skip
def test_a_number_below_zero_has_a_minus_sign(text: str, said: str) -> None:
    assert say("marks-mm-apart-dpi", text, 1).values["a"] == said
    assert translated(text, "en") == said
    assert translated(text, "de") == re.sub(r"(?<=\d)\.(?=\d)", ",", said)


def test_what_is_put_together_is_known_in_whole_and_in_parts() -> None:
    inner = within(say("tighten-belt-unless-tight"))
    whole = together("; ", [say("nothing-while-small", inner), "plain"])
    assert whole == "Nothing, as long as it stays this small. If it grows: tighten the belt, unless it is tight.; plain"
    told = json.loads(json.dumps(messages_of({"said": [whole, 1.0]})))
    assert set(told) == {str(whole), str(whole).removesuffix("; plain"), str(inner)}
    back = restored({"said": [str(whole), "plain"]}, told)["said"]
    assert isinstance(back[0], Said)
    assert isinstance(back[0].values["0"], Said)
    assert back[0].values["0"].values["a"].id == "tighten-belt-unless-tight"
    assert not isinstance(back[1], Said)


@pytest.mark.parametrize("told", [None, 3, {}, {"values": 3}, {"id": 1, "values": {"a": "x", "b": 4}}])
def test_what_a_foreign_file_tells_of_its_texts_may_be_nonsense(told: object) -> None:
    assert restored({"x": ["x", {"y": "x"}, 2.0]}, {"x": told}) == {"x": ["x", {"y": "x"}, 2.0]}


def test_an_error_is_a_message_of_its_parts() -> None:
    error = InputError("/home/me/scan.png", wanted=say("flat-scan"), came="none", todo=say("rename"))
    error = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own, as a worker sends it
    message = error.message.replace("/home/me/", "")
    told = messages_of(message)
    assert told[str(message)] == {
        "id": "why", "values": {"a": "scan.png", "b": "a flat scan", "c": "none", "d": "rename it"},
    }  # fmt: skip
    assert {told[part]["id"] for part in ("a flat scan", "rename it")} == {"flat-scan", "rename"}


def test_help_is_told_in_german_and_nothing_else_is(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = set()

    class Words(dict):
        def get(self, text: str, other: str = "") -> str:
            asked.add(text)
            return str(super().get(text, other))

    monkeypatch.setattr("printmend.cli.terminal.help_words", lambda: Words(help_words()))

    def read(command: click.Command, above: click.Context | None, name: str) -> None:
        ctx = click.Context(command, above, name, obj=None if above else Terminal(GERMAN))
        with ctx:
            ctx.get_help()
        for each in command.list_commands(ctx) if isinstance(command, click.Group) else ():
            below = command.get_command(ctx, each)
            if below.callback.__module__.startswith("printmend."):
                read(below, ctx, each)

    read(group, None, "printmend")
    assert set(help_words()) - asked == set(), "nothing says these"
    metavars = re.compile(r"[A-Za-z.|\[\]{}-]+")  # SCAN…, of the line of use
    assert {text for text in asked - set(help_words()) if not metavars.fullmatch(text)} == set()


def test_a_locale_or_an_option_chooses_the_language_of_help() -> None:
    def told(*words: str, language: str = "en") -> str:
        return CliRunner().invoke(group, words, obj=Terminal(language), prog_name="printmend").output

    assert "Usage: printmend mend [OPTIONS]" in told("mend", "--help")
    assert "[default: 127.0.0.1]" in " ".join(told("studio", "--help").split())  # no number with a point
    assert told("mend", "--help", language="de") == told("--lang", "de", "mend", "--help")
    german = told("mend", "--help", language="de")
    assert german.startswith("Aufruf: printmend mend [OPTIONEN] FILE|FOLDER|-...\n\n  G-Code so umschreiben")
    assert re.search(r"Gleichzeitig bearbeitete Dateien\.\s+\[Vorgabe:\s+1;\s+1\s+bis\s+64\]", german)
    assert "\n  Beispiel: printmend mend part.gcode" in german


def test_the_catalogue_is_read_as_gettext_reads_it() -> None:
    read = polib.pofile(str(SOURCES / "messages" / "de.po"))
    messages = {
        one.msgctxt + many: (english, german)
        for one in read
        if one.msgctxt != HELP
        for many, english, german in (
            ("", one.msgid, one.msgstr or one.msgstr_plural[0]),
            *([(MANY, one.msgid_plural, one.msgstr_plural[1])] if one.msgid_plural else []),
        )
    }
    assert catalogue() == messages
    assert help_words() == {one.msgid: one.msgstr for one in read if one.msgctxt == HELP}
