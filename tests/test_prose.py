"""Every page is read once: short sentences, and none of the habits that need a second reading.

Why a test of our own: Vale's packages fetch its program when they are first run, proselint knows neither Markdown nor
sentence length, and textlint would bring Node and 193 packages into the gate for two rules.
"""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest
from markdown import markdown

from printmend.messages import catalogue
from tests.test_docs import PAGES, ROOT

READ = [*PAGES, *sorted(ROOT.glob("integrations/*/README.md"))]
MOST_WORDS = 30
# After a full stop (not that of "Fig. 6") and what closes a quote, before a capital letter or a number.
ENDS = r"""(?<=[.!?])(?<!Fig\.)(?<!eq\.)[)"”’*]*\s+(?=["“‘(*]*(?:[A-Z0-9*]|printmend))"""
FORMULA = r"[=<≤≥±√Σ←·₀₁]"  # a sentence that carries one may be as long as its formula
# Each habit, and what to write instead; CONTRIBUTING.md has whole sentences before and after.
HABITS = {
    r"\bthat which\b": "name the thing",
    r"^What\b(?!.*\?$)": "name the thing that the sentence is about",
    r"\bwanted\b.*\bgot\b": "say what is wrong, then what to do",
    r"\bbe it\b|\bhence\b|\bthere(?:by|of)\b|\bwhereof\b": "so, of it, because",
    r", for (?:it|they|there|nobody) ": "because",
    r"\band said(?: so)?\b|\bis said, too\b": "and printmend says so",
    r"\b(?:is|are) to be\b": "must be, should be",
    r"\btold (?:from|of)\b": "distinguished from, reported as",
    r"\bto first order\b": "say what happens",
    r"\boff, typically\b": "RMS error",
    r"\bof that nothing explains\b": "unexplained",
}


class Prose(HTMLParser):
    """Collects a page's paragraphs and list items; tables, code blocks and headings are no sentences."""

    SKIPPED = ("pre", "table", "h1", "h2", "h3", "h4")
    BLOCKS = ("p", "li")

    def __init__(self) -> None:
        super().__init__()
        self.found, self.skipping, self.in_code = [""], 0, False

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.skipping += tag in self.SKIPPED
        self.in_code |= tag == "code"
        if tag in self.BLOCKS:
            self.found.append("")

    def handle_endtag(self, tag: str) -> None:
        self.skipping -= tag in self.SKIPPED
        if tag == "code":
            self.in_code = False
        if tag in self.BLOCKS:
            self.found.append("")

    def handle_data(self, data: str) -> None:
        if not self.skipping:
            self.found[-1] += "CODE" if self.in_code else data  # code within a sentence counts as one word


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of a page."""
    prose = Prose()
    prose.feed(markdown(text, extensions=["tables", "fenced_code", "md_in_html"]))
    for block in prose.found:
        yield from filter(None, re.split(ENDS, " ".join(block.split())))


def faults(sentence: str) -> list[str]:
    words = [word for word in sentence.split() if re.search(r"\w", word)]
    long = len(words) > MOST_WORDS and not re.search(FORMULA, sentence)
    told = [f"{len(words)} words; {MOST_WORDS} at most"] if long else []
    for habit, instead in HABITS.items():
        told += [f"{found!r}: {instead}" for found in re.findall(habit, sentence)[:1]]
    return told


@pytest.mark.parametrize("page", READ, ids=lambda page: str(page.relative_to(ROOT)))
def test_each_sentence_is_short_and_plain(page: Path) -> None:
    bad = [f"{', '.join(told)}: {one}" for one in sentences(page.read_text(encoding="utf-8")) if (told := faults(one))]
    assert not bad, f"{page.relative_to(ROOT)}: {len(bad)} sentences\n" + "\n".join(bad)


def test_each_sentence_of_the_program_is_short_and_plain() -> None:
    for name, (english, _) in catalogue().items():
        for one in filter(None, re.split(ENDS, re.sub("`[^`]*`", "CODE", english))):
            assert not faults(one), f"{name}: {one}"


def test_a_bad_sentence_is_seen() -> None:
    page = "# What stands here\n\nIt is that which holds. `that which` is code. What nothing explains widens it.\n\n- "
    page += "so " * 31
    assert [len(faults(one)) for one in sentences(page)] == [1, 0, 1, 1]
    assert faults("What does it cost?") == []
