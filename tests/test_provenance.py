"""What a G-code file is to a printer: five states, by its seal and by the host's records."""

import ast
import json
import os
import re
from pathlib import Path

import polib
import pytest
import tomli_w

from printmend import provenance
from printmend.corruption import Corruption, Drive
from printmend.corruption.transmission import Play
from printmend.mend import mend_gcode
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.printer.toml import printer_section
from printmend.provenance import Ledger, Model, NoModelError, Verdict, read_model, record_of
from tests.mending import coarsely

SQUARE = b"G28\nG90\nM83\nG1 Z0.2\nG1 X60 Y60 F6000\n" + b"".join(
    b"G1 X%d Y%d E1 F1800\n" % corner for corner in [(80, 60), (80, 80), (60, 80), (60, 60)]
)


def model_at(path: Path, slack_mm: float, printer: str = "ender3") -> Model:
    drives = Drive(belt=Play(slack_mm)), Drive(belt=Play(0.6))
    write_model(path, exact_model(coarsely(Corruption(drives), read_printer(printer))))
    return read_model(str(path))


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> dict[str, Model]:
    folder = tmp_path_factory.mktemp("models")
    return {
        "old": model_at(folder / "old.json", 0.3),
        "new": model_at(folder / "new.json", 0.4),
        "other": model_at(folder / "other.json", 0.4, "prusa-mk3s"),
        "folder": folder,
    }


@pytest.fixture(scope="module")
def mended(models) -> dict[str, bytes]:
    """The square mended with each model."""
    from printmend.model.model import read_model as read

    (models["folder"] / "square.gcode").write_bytes(SQUARE)
    texts = {}
    for name in ("old", "new", "other"):
        out = models["folder"] / f"{name}.gcode"
        mend_gcode(models["folder"] / "square.gcode", read(models["folder"] / f"{name}.json"), out, force=True)
        texts[name] = out.read_bytes()
    return texts


@pytest.fixture
def host(tmp_path: Path):
    """Judge bytes as a file of a host."""

    class Host:
        ledger, folder = Ledger(str(tmp_path / "ledger")), tmp_path

        def judge(self, text: bytes, model: Model | None, name: str = "x.gcode", **more) -> Verdict:
            (tmp_path / name).write_bytes(text)
            return self.ledger.judge(str(tmp_path / name), model, **more)

        def record(self, source: bytes, result: bytes, model: Model | None) -> None:
            (tmp_path / "source.gcode").write_bytes(source)
            (tmp_path / "result.gcode").write_bytes(result)
            report = {"before": {"rms_mm": 0.2}, "after": {"rms_mm": 0.01}, "layers": []}
            place = str(tmp_path / "source.gcode")
            self.ledger.write(record_of(place, str(tmp_path / "result.gcode"), model, original=place, report=report))

    return Host()


@pytest.mark.parametrize("more", [{"homing": {"switch": "phase"}}, {"limits": {"crossing_mm_s2": 15000.0}}])
def test_what_an_owner_changes_in_the_firmware_makes_no_other_printer(more: dict, models, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(printer_section(read_printer("ender3")) | more))
    changed = model_at(tmp_path / "changed.json", 0.4, str(tmp_path / "mine.toml"))
    assert changed.digest != models["new"].digest
    assert changed.printer == models["new"].printer


def test_a_model_is_identified_as_printmend_does(models, tmp_path: Path) -> None:
    from printmend.model.model import read_model as read

    assert models["new"].digest == read(models["folder"] / "new.json").digest
    assert models["new"].key.startswith(models["new"].digest)
    assert models["new"].printer == models["old"].printer != models["other"].printer
    (tmp_path / "m.json").write_text((models["folder"] / "new.json").read_text().replace("0.4", "0.5", 1))
    for text, words in [(None, "damaged"), ("{}", "not a printer"), ("[1]", "not a printer"), ("", "not a printer")]:
        if text is not None:
            (tmp_path / "m.json").write_text(text)
        with pytest.raises(NoModelError, match=words):
            read_model(str(tmp_path / "m.json"))
    with pytest.raises(NoModelError, match="No such file"):
        read_model(str(tmp_path / "absent.json"))


def test_a_seal_alone_tells_the_five_states(host, models, mended) -> None:
    """As for files that were mended on another computer: no record is here."""
    assert host.judge(SQUARE, models["new"]).state == "unmended"
    assert host.judge(mended["new"], models["new"]).state == "current"
    assert host.judge(mended["old"], models["new"]).state == "foreign"  # a model that was never here
    host.ledger.remember(models["old"])
    host.ledger.remember(models["other"])
    assert host.judge(mended["old"], models["new"]).state == "stale"
    assert host.judge(mended["other"], models["new"]).state == "foreign"
    mark = next(line for line in mended["new"].splitlines(True) if line.startswith(b"; mended by"))
    assert host.judge(mark + SQUARE, models["new"]).state == "forged"


def test_a_change_breaks_the_seal_but_comments_below_do_not(host, models, mended) -> None:
    text = mended["new"]
    assert host.judge(text + b"\n;SETTING_3 {}\r\n; end", models["new"]).state == "current"
    for changed in (
        text.replace(b"F1800", b"F1900", 1), b"G1 X5\n" + text, text + b"G1 X5\n", text + b";c\nG1 X5\n;c\n",
        text[: text.rindex(b"; sealed")], text.replace(b"\n", b"\r\n"), text[:-40] + b"0" * 39 + b"\n",
    ):  # fmt: skip
        assert host.judge(changed, models["new"]).state == "forged"


@pytest.mark.parametrize("text", [b"G1 X1\nG1 X2", b"G1 X1\r\nG1 X2\r\n", b"G1 X1\rG1 X2\r", b"G1 X1\n", b""])
def test_every_text_can_be_sealed(text: bytes, tmp_path: Path) -> None:
    place = tmp_path / "x.gcode"
    for pieces in ([text], [text[:3], text[3:]], [bytes([byte]) for byte in text]):
        place.write_bytes(b"".join(provenance.sealed(pieces, "key")))
        assert place.read_bytes().startswith(text)
        assert provenance.is_sealed(str(place), "key")
        assert not provenance.is_sealed(str(place), "other")


def test_a_record_tells_what_no_seal_can(host, models, mended) -> None:
    host.record(SQUARE, SQUARE, models["new"])  # a healthy printer's file stays as it is, without a mark
    assert host.judge(SQUARE, models["new"], "renamed.gcode").state == "current"
    assert host.judge(SQUARE, models["old"]).state == "stale"
    assert host.judge(SQUARE, models["other"]).state == "foreign"
    assert Ledger(str(host.folder / "ledger")).judge(str(host.folder / "x.gcode"), models["new"]).state == "current"
    assert host.judge(SQUARE + b"\n", models["new"]).state == "unmended"
    host.record(SQUARE, mended["new"], models["new"])
    verdict = host.judge(mended["new"], models["new"])
    assert verdict.record.promise == {"before": {"rms_mm": 0.2}, "after": {"rms_mm": 0.01}}
    assert verdict.record.program == __import__("printmend").__version__
    assert {record.result for record in host.ledger.records()} >= {verdict.sha256}
    host.ledger.forget(verdict.record)
    assert host.judge(mended["new"], models["new"]).record is None


def test_a_copy_of_an_earlier_original_is_stale(host, models, mended) -> None:
    host.record(SQUARE, mended["new"], models["new"])
    original = host.folder / "source.gcode"
    assert host.judge(mended["new"], models["new"], original=str(original)).state == "current"
    original.write_bytes(SQUARE + b"G1 X70\n")
    assert host.judge(mended["new"], models["new"], original=str(original)).state == "stale"
    original.unlink()
    assert host.judge(mended["new"], models["new"], original=str(original)).state == "current"


def test_sources_of_one_result_each_have_their_copy(host, models, mended) -> None:
    """Sources that differ below a file's precision are mended to the same bytes: neither's copy is stale."""
    other = SQUARE.replace(b"X80 ", b"X80.0000001 ")
    for source in (SQUARE, other, SQUARE):
        host.record(source, mended["new"], models["new"])
    for source, state in ((SQUARE, "current"), (other, "current"), (SQUARE + b"G1 X70\n", "stale")):
        (original := host.folder / "original.gcode").write_bytes(source)
        assert host.judge(mended["new"], models["new"], original=str(original)).state == state


def test_without_a_model_here_the_latest_record_says_which_is_in_use(host, models, mended) -> None:
    host.record(SQUARE, mended["old"], None)
    assert host.judge(mended["old"], None).state == "current"
    os.utime(host.folder / "ledger/records" / f"{host.judge(mended['old'], None).sha256}.json", (1, 1))
    host.record(SQUARE, mended["new"], None)
    assert host.judge(mended["new"], None).state == "current"
    assert host.judge(mended["old"], None).state == "stale"
    assert host.judge(mended["other"], None).state == "foreign"


def test_a_test_print_is_none_of_the_five(host, models, mended) -> None:
    probe = provenance.sealed_test_print(b"; printmend probe: 3 dots\n" + SQUARE)
    assert host.judge(probe, models["new"]).state == "test print"
    assert host.judge(probe, None).state == "test print"
    german = Ledger(str(host.folder / "ledger"), "de_DE").judge(str(host.folder / "x.gcode"), None)
    assert german.sentence == "Dieser Testdruck zeigt den Drucker, wie er ist; er wird nicht korrigiert."
    assert provenance.action("test print", {}) == "print"


def test_a_file_that_only_says_it_is_a_test_print_is_forged(host, models) -> None:
    says = b"; printmend probe: 3 dots\n" + SQUARE
    probe = provenance.sealed_test_print(says)
    own_seal = b"".join(provenance.sealed([says], models["new"].key))
    changed, longer = probe.replace(b"X", b"X1", 1), probe + b"G1 X1\n"
    other = SQUARE + probe[probe.index(b"; sealed by") :]
    for text in (says, own_seal, changed, longer, b"G1 X5\n" + probe):
        verdict = host.judge(text, models["new"])
        assert verdict.state == "forged"
        assert "says that it is a test print" in verdict.sentence
    assert host.judge(other, models["new"]).state == "unmended"
    first = provenance.sealed_test_print(b"; printmend first layer: of a part\n" + SQUARE)
    assert host.judge(first, models["new"]).state == "test print"


def test_the_owner_chooses_once_and_nonsense_is_no_choice() -> None:
    defaults = {state: provenance.action(state, {}) for state in ("current", *provenance.CHOICES)}
    assert defaults == {"current": "print", "stale": "mend", "foreign": "hold", "forged": "hold", "unmended": "mend"}
    assert provenance.action("foreign", {"foreign": "print"}) == "print"
    assert (
        provenance.action("foreign", {"foreign": "mend"}) == "hold"
    )  # of what another printer's file was, nobody knows
    assert provenance.action("current", {"current": "hold"}) == "print"


@pytest.mark.parametrize("text", ["", "[", "{}", "[]", '{"source": 1}', '{"result": "x", "promise": 3}'])
def test_half_a_record_is_none(text: str, host, models) -> None:
    verdict = host.judge(SQUARE, models["new"])
    place = host.folder / "ledger/records" / f"{verdict.sha256}.json"
    place.parent.mkdir(parents=True)
    place.write_text(text)
    (host.folder / "ledger/models.json").write_text(text)
    assert host.judge(SQUARE, models["new"]).state == "unmended"


def test_keys_are_for_their_owner_only(host, models) -> None:
    host.ledger.remember(models["new"])
    assert (host.folder / "ledger/models.json").stat().st_mode & 0o077 == 0
    assert models["new"].key in json.dumps(json.loads((host.folder / "ledger/models.json").read_text()))


def test_hosts_can_load_it_alone_and_old_python_can_read_it() -> None:
    text = Path(provenance.__file__).read_text()
    tree = ast.parse(text, feature_version=(3, 7))
    names = {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert names == {"__future__", "collections.abc", "hashlib", "hmac", "json", "os", "re", "typing"}
    copy = Path(__file__).parents[1] / "integrations/octoprint/octoprint_printmend/provenance.py"
    assert copy.read_text() == text, "cp src/printmend/provenance.py integrations/octoprint/octoprint_printmend/"


def test_octoprints_page_has_a_german_for_each_of_its_words() -> None:
    """Its page reads messages.po, its server messages.mo, which `polib.pofile(…).save_as_mofile(…)` makes of it."""
    plugin = Path(__file__).parents[1] / "integrations/octoprint/octoprint_printmend"
    page = (plugin / "static/js/printmend.js").read_text(encoding="utf-8")
    settings = (plugin / "templates/printmend_settings.jinja2").read_text(encoding="utf-8")
    asked = {*re.findall(r'gettext\("([^"]*)"\)', page), *re.findall(r"_\('([^']*)'\)", settings)}
    words, compiled = (
        {entry.msgid: entry.msgstr for entry in read(str(plugin / f"translations/de/LC_MESSAGES/messages.{kind}"))}
        for read, kind in ((polib.pofile, "po"), (polib.mofile, "mo"))
    )
    assert words.keys() == asked
    assert all(words.values())
    assert compiled == words
