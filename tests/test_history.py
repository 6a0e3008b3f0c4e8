"""The life of a printer: what was measured is remembered, wear is dated, repairs begin it anew."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from printmend.errors import ModelError
from printmend.mend.history import ageing_of, carry_on, draw_history, history_of, read_history, rows_of, trends_of
from printmend.messages import GERMAN, translated
from printmend.printer import read_printer

PRINTER = read_printer("ender3")
START = datetime(2026, 1, 1, tzinfo=UTC)
MONTH = timedelta(days=365.25 / 12)


def event(months: float, value: float, sd: float, kind: str = "play") -> dict:
    when = START + months * MONTH
    fault = {"part": "X", "kind": kind, "value": value, "sd": sd, "unit": "mm"}
    return {"event": "updated", "time": when.isoformat(), "seconds": when.timestamp(), "faults": [fault]}


def test_the_range_of_the_date_holds_the_truth():
    rng, held, off = np.random.default_rng(0), 0, []
    for _ in range(100):
        events = [event(month, 0.03 + 0.0125 * month + rng.normal(0, 0.004), 0.004) for month in range(5)]
        (one,) = trends_of(events)
        true = (START + 5.6 * MONTH).timestamp()
        if one.crossing_s is None:
            continue
        held += one.earliest_s <= true <= (one.latest_s or np.inf)
        off.append((one.crossing_s - START.timestamp()) / MONTH.total_seconds() / 5.6 - 1)
    assert len(off) > 90
    assert held > 0.75 * len(off)
    assert np.median(np.abs(off)) < 0.2


def test_what_has_passed_a_tenth_of_a_millimetre_says_so_and_when(tmp_path):
    """It was dated before; once it is passed nobody may read that only half a millimetre matters."""
    (grown,) = trends_of([event(month, 0.03 + 0.0125 * month, 0.004) for month in range(10)])
    assert grown.words.startswith("0.142 mm now, grows by 0.012 mm a month; it passed 0.10 mm about June 2026: since")
    assert "It will reach 0.50 mm about" in grown.words
    assert grown.json()["passed"]["when"] == (START + 5.6 * MONTH).date().isoformat()
    (steady,) = trends_of([event(month, 0.3, 0.004) for month in range(4)])
    assert "and steady; it has been above 0.10 mm since the first measurement: prints are off by 0.1" in steady.words
    assert "Tighten the belt" in steady.words
    (two,) = trends_of([event(0, 0.05, 0.004), event(1, 0.15, 0.004)])
    assert two.passed.when_s == pytest.approx((START + 0.5 * MONTH).timestamp())
    (severe,) = trends_of([event(month, 0.4 + 0.05 * month, 0.004) for month in range(5)])
    assert "it passed 0.50 mm about March 2026" in severe.words
    assert severe.crossing_s is None
    draw_history(tmp_path / "wear.png", (grown, steady, two, severe))


def test_an_idler_is_one_fault_though_its_length_comes_out_a_little_other():
    lengths = ("31.4", "31.3", "31.4", "31.5")
    (idler,) = trends_of([event(k, 0.05 + 0.03 * k, 0.004, f"period-{mm}") for k, mm in enumerate(lengths)])
    assert [one.value for one in idler.sizes] == pytest.approx([0.05, 0.08, 0.11, 0.14])
    assert idler.name == "X error every 31.5 mm"
    assert idler.is_sure


def test_a_repair_begins_anew_and_what_is_steady_stays(tmp_path):
    worn = [event(month, 0.1 + 0.05 * month, 0.004) for month in range(5)]
    mended = [event(5 + month, 0.03, 0.004) for month in range(3)]
    (one,) = trends_of([*worn, *mended])
    assert one.since == 5
    assert "steady" in one.words
    (few,) = trends_of(worn[:2])
    assert "three measurements" in few.words
    draw_history(tmp_path / "none.png", ())


def test_old_knowledge_weighs_less_and_wear_is_expected(tmp_path):
    model = tmp_path / "printer.mend.json"
    assert ageing_of(model) is None
    history_of(model).write_text(
        "".join(json.dumps(event(month, 0.1 + 0.02 * month, 0.004)) + "\n" for month in range(4))
    )
    soon, late = (ageing_of(model, START + months * MONTH) for months in (3.5, 9.0))
    assert soon.of("x")["play"][0] == pytest.approx(0.01, abs=0.002)
    assert late.of("x")["play"][0] == pytest.approx(0.12, abs=0.01)
    assert late.of("x")["play"][1] > 3 * soon.of("x")["play"][1]
    assert not late.of("y")
    assert ageing_of(model, START).months == 0.0


def test_a_successor_carries_the_history_on(tmp_path):
    """Each update may write another file: a trend needs all of their measurements."""
    first, second, third = (tmp_path / f"{name}.mend.json" for name in ("first", "second", "third"))
    for number, (before, path) in enumerate(((first, first), (first, second), (second, third))):
        carry_on(before, path)
        with history_of(path).open("a") as file:
            file.write(json.dumps(event(number, 0.1 + 0.05 * number, 0.004)) + "\n")
    assert [len(read_history(path)) for path in (first, second, third)] == [1, 2, 3]
    assert trends_of(read_history(third))[0].is_sure
    carry_on(first, third)  # written anew from the first: what it has of its own stays
    assert [one["seconds"] for one in read_history(third)] == [event(k, 0, 0)["seconds"] for k in range(3)]


def test_a_damaged_history_is_named(tmp_path):
    model = tmp_path / "printer.mend.json"
    with pytest.raises(ModelError, match=r"expected a printer\.mend\.json, found no such file"):
        read_history(model)
    model.touch()
    with pytest.raises(ModelError, match="expected a history, found no such file"):
        read_history(model)
    for value in ("NaN", "1e999", '"much"'):
        fault = f'{{"part": "x", "kind": "play", "value": {value}, "sd": 0.01, "unit": "mm"}}'
        learned = f'{{"event": "learned", "time": "2026-11-30T12:00:00+00:00", "faults": [{fault}]}}\n'
        for text in ('{"event": "learned"}\n', learned):
            history_of(model).write_text(text)
            with pytest.raises(ModelError, match="line 1"):
                read_history(model)


@pytest.mark.parametrize("path", ["", ".", "/"])
def test_a_path_without_a_name_has_no_history(path):
    with pytest.raises(ModelError, match="found a folder"):
        read_history(Path(path))


def test_a_trend_is_said_in_german_too():
    (grown,) = trends_of([event(month, 0.03 + 0.0125 * month, 0.004) for month in range(10)])
    german = translated(grown.words, GERMAN)
    assert german.startswith("jetzt 0,142 mm, steigt um 0,012 mm im Monat; etwa im Juni 2026 überschritt es 0,10 mm:")
    assert "Den Riemen spannen" in german
    assert translated(rows_of([event(0, 0.05, 0.004)])[0][2], GERMAN) == "X: Spiel des Riemens 0,050 mm"
