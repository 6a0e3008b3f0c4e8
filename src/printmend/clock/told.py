"""Rewrite the printing times that a file states (M73, slicers' comments) for the mended file."""

import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from printmend.clock.clock import Stopwatch
from printmend.gcode.write import TimePlace

_COPY_BYTES = 1 << 20  # bytes copied at once
_WORD = re.compile(rb"(?<![A-Za-z])([PQRSCDpqrscd])\s*(\d{1,9}(?:\.\d{1,9})?)(?![\d.])")
_NUMBER = re.compile(rb"(?<![\d.])\d{1,9}(?:\.\d{1,9})?(?![\d.])")
_UNITS_S = {b"d": 86400, b"h": 3600, b"m": 60, b"s": 1}
_SPAN = re.compile(
    rb"(?:(?<!\d)\d{1,9} ?(?:d(?:ays?)?|h(?:ours?)?|m(?:in(?:utes?)?)?|s(?:ec(?:onds?)?)?)(?![a-z])(?:,? )?)+",
    re.IGNORECASE,
)
_PART = re.compile(rb"(\d+)( ?)([dhms])", re.IGNORECASE)
_NOT_FILLED_IN = b"6666"  # Cura's engine writes this if nobody fills in the time
_LEAST_S = 1e-3  # a time must be longer than this to divide by it


@dataclass(frozen=True)
class Moment:
    """A place of a file: the times of both prints there, and in all [s]."""

    before_s: float
    after_s: float
    before_all_s: float
    after_all_s: float

    def whole(self, value: float) -> float:
        """Return a total time, converted to the mended print."""
        return value * _ratio(self.after_all_s, self.before_all_s)

    def gone(self, value: float) -> float:
        """Return a time since the start, converted to the mended print."""
        return value * _ratio(self.after_s, self.before_s)

    def left(self, value: float) -> float:
        """Return a time until the end, converted to the mended print."""
        return value * _ratio(self.after_all_s - self.after_s, self.before_all_s - self.before_s)

    def percent(self, value: float) -> float:
        """Return a share of the elapsed time [%], converted to the mended print."""
        return min(self.gone(value) / _ratio(self.after_all_s, self.before_all_s), 100.0)


def told_anew(text: bytes, moment: Moment) -> bytes:
    """Return a line that states a printing time, with the mended print's times in the line's own format.

    Each is scaled by the ratio of the clock's two times, so that delays unknown to the clock stay as the slicer assumed
    them. A comment behind M73 stays.
    """
    if text[:1] in b"Mm":
        command, semicolon, comment = text.partition(b";")
        return _WORD.sub(lambda found: _word(found, moment), command) + semicolon + comment
    head, colon, value = text.partition(b":")
    if b"=" in head or not colon:
        head, colon, value = text.partition(b"=")
    if _SPAN.search(value):
        return head + colon + _SPAN.sub(lambda found: _span(found[0], moment), value)
    if value.strip() == _NOT_FILLED_IN:
        return text
    name = head.upper()
    change = moment.gone if b"ELAPSED" in name else (moment.left if b"REMAINING" in name else moment.whole)
    return head + colon + _NUMBER.sub(lambda found: _like(found[0], change(float(found[0]))), value, count=1)


def told_as_a_whole(text: bytes, watch: Stopwatch) -> bytes:
    """Return a line beside a program that states its printing time; both clocks of ``watch`` have finished."""
    return told_anew(text, Moment(0.0, 0.0, watch.before.seconds, watch.after.seconds))


def with_times(
    texts: Iterable[memoryview], places: Sequence[TimePlace], watch: Stopwatch, folder: Path | None
) -> Iterator[bytes | memoryview]:
    """Yield a text with the times at its ``places`` rewritten, and let both clocks of ``watch`` finish.

    ``places`` grows while ``texts`` are made (`rewrite`). The text from the first place on waits in a temporary file in
    ``folder`` until all times are known.
    """
    at = 0
    with tempfile.TemporaryFile(dir=folder) as spool:
        for text in texts:
            if places:
                spool.write(text)
            else:
                at += len(text)
                yield text
        watch.finish()
        yield from _patched(spool, at, places, watch)


def _patched(spool: IO[bytes], at: int, places: Sequence[TimePlace], watch: Stopwatch) -> Iterator[bytes]:
    """Yield the contents of ``spool``, from byte ``at`` of the text on, with the times at ``places`` rewritten."""
    spool.seek(0)
    for place, moment in zip(places, _moments(watch), strict=False):
        yield from _copied(spool, place.at - at)
        spool.seek(len(place.text), 1)
        yield told_anew(place.text, moment)
        at = place.at + len(place.text)
    yield from iter(lambda: spool.read(_COPY_BYTES), b"")


def _moments(watch: Stopwatch) -> Iterator[Moment]:
    """Yield the moment of each place that states the time."""
    whole = watch.before.seconds, watch.after.seconds
    count = min(int(watch.before.state.noted), len(watch.before.times_s))
    for before_s, after_s in zip(watch.before.times_s[:count], watch.after.times_s[:count], strict=True):
        yield Moment(float(before_s), float(after_s), *whole)


def _copied(spool: IO[bytes], size: int) -> Iterator[bytes]:
    while size > 0 and (data := spool.read(min(size, _COPY_BYTES))):
        yield data
        size -= len(data)


def _ratio(after_s: float, before_s: float) -> float:
    """Return the ratio of two times, 1 if the first is almost zero."""
    return after_s / before_s if before_s > _LEAST_S and after_s >= 0.0 else 1.0


def _word(found: re.Match[bytes], moment: Moment) -> bytes:
    """Return a word of M73: P and Q are percent, R and S minutes until the end, C and D until the next stop."""
    letter, value = found[1].upper(), float(found[2])
    change = moment.percent if letter in b"PQ" else moment.left
    return found[0][: found.start(2) - found.start()] + _like(found[2], change(value))


def _like(old: bytes, value: float) -> bytes:
    """Return a number with as many decimals as the old one."""
    decimals = len(old.partition(b".")[2])
    return f"{value:.{decimals}f}".encode()


def _span(old: bytes, moment: Moment) -> bytes:
    """Return a time in the same units as the old one: days, hours, minutes, seconds; the first may be large."""
    parts = _PART.findall(old)
    units = [_UNITS_S[unit.lower()] for _, _, unit in parts]
    seconds = moment.whole(sum(int(number) * unit for (number, _, _), unit in zip(parts, units, strict=True)))
    numbers = iter(_split(round(seconds / units[-1]) * units[-1], units))
    return _PART.sub(lambda found: b"%d%b%b" % (next(numbers), found[2], found[3]), old)


def _split(seconds: float, units_s: Sequence[int]) -> list[int]:
    """Split seconds into units, the largest first."""
    numbers = []
    for unit_s in units_s:
        numbers.append(int(seconds // unit_s))
        seconds -= numbers[-1] * unit_s
    return numbers
