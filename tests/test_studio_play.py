"""The sliders of the play screen: every effect that the program knows, and those of other packages."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from printmend.corruption import Corruption
from printmend.corruption.cause import Cause
from printmend.effects import EFFECTS
from printmend.messages import Said, page_messages
from printmend.studio import play as plate
from printmend.studio.app import create_app
from printmend.studio.jobs import Jobs
from printmend.studio.offered import causes_of, offered_effects
from printmend.studio.places import Places
from printmend.studio.play import Faults, play_printer, shown
from printmend.studio.scene import as_printed, read_drawing
from printmend.twin import Twin

# a layer lies elsewhere as a whole, or only its lines are wider
SHAPELESS = {"place", "origin", "shift", "bead", "wobble", "layer"}


def _row(card: dict[str, Any]) -> dict[str, Any]:
    values = {slider["key"]: slider["value"] for slider in card["sliders"]}
    return {"name": card["name"], "on": (card["on"] or [None])[0], "values": values}


def test_every_effect_has_sliders_that_break_the_printer() -> None:
    cards = offered_effects(play_printer()[0])
    assert [card["name"] for card in cards] == list(EFFECTS)
    assert {card["name"] for card in cards if not card["possible"]} == {"aspect", "lag", "lag_wear"}  # of a CoreXY
    for card in cards:
        assert isinstance(card["title"], Said), card["name"]
        assert card["sliders"], card["name"]
        for slider in card["sliders"]:
            if not slider["choices"]:
                assert slider["low"] <= slider["value"] <= slider["high"], card["name"]
                assert slider["low"] < slider["high"]
        if card["possible"]:
            drawn = shown(Faults(causes=causes_of([_row(card)])))
            assert (max(drawn["rms_mm"], drawn["part_rms_mm"]) > 0.008) == (card["name"] not in SHAPELESS), card["name"]


def test_play_goes_below_0_as_where_the_firmware_takes_up_too_much() -> None:
    card = next(card for card in offered_effects(play_printer()[0]) if card["name"] == "play")
    (size,) = card["sliders"]
    assert size["low"] == -size["high"]
    row = _row(card) | {"values": {"size_mm": size["low"]}}
    assert shown(Faults(causes=causes_of([row])))["rms_mm"] > 0.3


def test_an_effect_of_another_package_appears_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    class Mine:
        """A belt of mine that is kinked."""

        name = "mine"

        def __getattr__(self, key: str) -> object:
            return getattr(EFFECTS["splice"], key)

    monkeypatch.setitem(EFFECTS, "mine", Mine())
    card = offered_effects(play_printer()[0])[-1]
    assert (card["name"], card["title"], card["possible"]) == ("mine", "A belt of mine that is kinked", True)
    assert [slider["key"] for slider in card["sliders"]] == ["at_mm", "width_mm", "size_mm"]
    assert shown(Faults(causes=causes_of([_row(card)])))["rms_mm"] > 0.05


def test_the_page_asks_for_them_and_is_told_what_does_not_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Jobs, "warm", lambda jobs: None)
    with TestClient(
        create_app(Places.below(tmp_path / "studio"), workers=1), base_url="http://127.0.0.1:8765"
    ) as client:
        told = client.get("/api/v1/play/effects").json()
        assert {card["name"] for card in told["effects"]} == set(EFFECTS)
        splice = next(card for card in told["effects"] if card["name"] == "splice")
        german = page_messages()[told["messages"][splice["title"]]["id"]]["de"]
        assert german == "eine Stoßstelle oder Delle im Riemen"
        healthy = client.post("/api/v1/play/preview", json={}).json()
        broken = client.post("/api/v1/play/preview", json={"effects": [_row(splice)]}).json()
        assert broken["rms_mm"] > healthy["rms_mm"] + 0.05
        for effects in ([{"name": "no-such"}], [{"name": "splice", "values": {"size_mm": 1e9}}],
                        [{"name": "aspect"}], [{"name": "splice", "on": "z"}]):  # fmt: skip
            assert client.post("/api/v1/play/preview", json={"effects": effects}).status_code in (400, 422)


def test_what_acts_along_the_path_is_in_the_picture_of_the_part(tmp_path: Path) -> None:
    printer = play_printer()[0]
    (path := tmp_path / "part.gcode").write_bytes(plate.plate_gcode(printer))
    drawing = read_drawing(path, printer)
    broken = Corruption(causes=(Cause("drift", "x", (("size_mm", 0.5),)),))
    twin = Twin.of(broken, printer)
    assert as_printed(drawing, twin.homed(), aligned=True).raw_error_mm.max() < 1e-9
    scene = as_printed(drawing, twin.homed(), aligned=True, along=twin.printed_along)
    places = np.concatenate([[[*printer.home_mm, printer.z.home_mm]], drawing.points_mm])
    follow = (twin.follow(places)[1:] - drawing.points_mm)[drawing.keep, :2]
    off = scene.raw_mm
    np.testing.assert_allclose(off - off.mean(axis=0), follow - follow.mean(axis=0), atol=0.02)
    assert scene.raw_error_mm.max() > 0.1
