"""The studio as a person uses it, in Debian's Chromium: the whole way, every screen, the keyboard, what goes wrong."""

import http.client
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from parts import part
from playwright.sync_api import Browser, Page, Route, expect
from studio_server import CHROMIUM, Server, Watched, chromium, drawn_finely, until

from printmend.client import Studio
from printmend.corruption import Corruption, CrookedFrame, Drive, EccentricBore, Play
from printmend.measure import read_plan
from printmend.measure.image import read_image, write_image
from printmend.mend.against import judge_gcode
from printmend.messages import GERMAN, messages_of, say, together, translated
from printmend.model.model import exact_model, write_model
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend.twin.gcode import print_gcode
from printmend.twin.scanner import DEFAULT, scan_trace

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
PRINTER = read_printer("ender3")
FAULTS = Corruption(
    (Drive(pulley=EccentricBore(0.6, 1.0), belt=Play(0.3)), Drive(belt=Play(0.15))), CrookedFrame(skew_deg=0.5)
)
DPI, NEAR_MM = 300.0, 0.4
COLUMNS = "x_mm,y_mm,x_measured_mm,y_measured_mm"
expect.set_options(timeout=300_000)  # as long as a busy machine may take: nothing on a page is there at once


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as one:
        yield one


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    one = Server(tmp_path_factory.mktemp("studio"))
    yield one
    one.stop()


def _free_name(server: Server, name: str) -> str:
    """Return a name that no printer has: a test that is run once more finds what it left."""
    taken = {one["name"] for one in Studio(server.address).get("/printers")}
    return next(free for free in (name, *(f"{name} {n}" for n in range(2, 99))) if free not in taken)


def _measured(server: Server, name: str) -> str:
    """Add a printer whose faults are known; return its key."""
    key = str(Studio(server.address).post("/printers", {"preset": "ender3", "name": _free_name(server, name)})["id"])
    write_model(server.folder / "printers" / key / "printer.mend.json", exact_model(Twin.of(FAULTS, PRINTER).homed()))
    return key


@pytest.fixture(scope="module")
def known(server: Server) -> str:
    """A learned printer with a mended part and a check print's verdict; its key. Tests only look at it."""
    studio, twin, rng = Studio(server.address), Twin.of(FAULTS, PRINTER), np.random.default_rng(3)
    name = _free_name(server, "Ender in the cellar")
    key = str(studio.post("/printers", {"preset": "ender3", "name": name})["id"])
    studio.post(f"/printers/{key}/probe")
    plan = read_plan(server.folder / "printers" / key / "probe.json")

    def uploaded(printed_mm: np.ndarray) -> str:
        rows = np.hstack([plan.marks_mm, printed_mm + rng.normal(0, 0.02, plan.marks_mm.shape)])
        np.savetxt(table := server.folder / "table.csv", rows, "%.4f", ",", header=COLUMNS, comments="")
        return studio.upload(table)

    printed_mm = twin.follow(plan.waypoints_mm)[plan.rows]
    studio.wait(studio.post(f"/printers/{key}/learn", {"upload": uploaded(printed_mm)})["id"])
    studio.wait(studio.post(f"/printers/{key}/verify", {"uploads": [uploaded(plan.marks_mm)]})["id"])
    (source := server.folder / "part.gcode").write_bytes(part(3))
    job = studio.post(f"/printers/{key}/mend", {"upload": studio.upload(source)})["id"]
    assert studio.wait(job)["prediction"]["after"]["rms_mm"] < 0.05
    return key


def _page(browser: Browser, server: Server, **options: object) -> Watched:
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 860}, "locale": "en-GB", **options})  # type: ignore[arg-type]
    return Watched(context.new_page(), server.address)


def _fits(page: Page, what: object) -> None:
    """Wait until nothing is wider than the window: drawings follow a change of its size a moment later."""
    until(
        lambda: page.evaluate("document.documentElement.scrollWidth <= innerWidth"),
        what=f"a page as wide as its window: {what}",
    )


def _ok(watched: Watched) -> None:
    assert watched.problems == []
    assert watched.foreign == []
    watched.page.context.close()


def _scan(path: Path, printed_mm: np.ndarray, plan_path: Path, seed: int) -> Path:
    plan = read_plan(plan_path)
    trace = Trace(plan.waypoints_mm, printed_mm)
    scan = scan_trace(trace, plan, dpi=DPI, degradations=DEFAULT, rng=np.random.default_rng(seed))
    write_image(path, scan.image, dpi=DPI)
    return path


def test_from_a_new_printer_to_the_proof(browser: Browser, server: Server, tmp_path: Path) -> None:
    watched = _page(browser, server, device_scale_factor=1.5)
    page, twin = watched.page, Twin.of(FAULTS, PRINTER)
    page.goto(server.address + "#/printers")
    page.get_by_role("link", name="New printer").click()
    page.get_by_label("Like which printer").select_option("ender3")
    page.get_by_label("Name").fill(name := _free_name(server, "Workshop, the old one"))
    page.get_by_role("button", name="Add it").click()
    for tab, drawn in (("What is wrong", ".mpart"), ("Mend", "path.m"), ("Prove", "circle.fm")):
        page.get_by_role("link", name=tab, exact=True).click()  # each shows what will be there
        expect(page.locator(f".stage.ghost {drawn}").first).to_be_visible()
    page.get_by_role("link", name="To the test print").click()
    page.get_by_role("button", name="Make the test print").click()
    with page.expect_download() as load:
        page.get_by_role("link", name="Download the test print").click()
    assert load.value.suggested_filename == "probe.gcode"
    key = page.url.split("/")[-2]
    plan_path = server.folder / "printers" / key / "probe.json"
    plan = read_plan(plan_path)
    page.set_input_files(
        "input[type=file][accept='image/*']", _scan(tmp_path / "scan.png", twin.follow(plan.waypoints_mm), plan_path, 1)
    )
    page.wait_for_selector("text=dots found")
    rings = page.locator("svg circle")
    until(lambda: rings.count() > 590)
    missing = int(page.get_by_text(re.compile(r"^not found \d+$")).inner_text().split()[-1])
    expect(page.locator("#scan path")).to_have_count(missing)  # a cross where each should be
    expect(page.get_by_test_id("asked").locator("ellipse")).to_have_count(2)  # the two dots to measure
    rings.nth(300).click()
    expect(page.get_by_text("left out 1")).to_be_visible()
    page.locator("#scan").evaluate("(scan) => { scan.scrollIntoView({ block: 'center' }); scan.blur(); }")
    watched.picture("measure")
    page.get_by_role("button", name="Learn from this").click()
    page.wait_for_selector("#machine")
    for words in ("The frame is not square", "X pulley is off its centre", "X belt has play", "Y belt has play"):
        expect(page.get_by_role("heading", name=words), words).to_be_visible()
    page.get_by_label("Shown larger").fill("20")
    expect(page.get_by_text("faults 20 times larger")).to_be_visible()
    watched.picture("wrong")
    page.get_by_role("link", name="Mend", exact=True).click()
    (source := tmp_path / "gear wheel.gcode").write_bytes(part(2))
    page.set_input_files("input[type=file][accept*=gcode]", source)
    page.wait_for_selector("[data-testid=part]")
    with page.expect_download() as load:
        page.get_by_role("link", name="Download mended").click()
    mended = load.value.path()
    assert load.value.suggested_filename == "gear wheel.mended.gcode"
    judged = judge_gcode(source, mended, twin)  # by the twin, which knows the truth
    assert judged.after.rms_mm < 0.05 < 0.25 < judged.before.rms_mm
    until(lambda: page.locator("canvas").get_attribute("data-frame"))
    drawn_finely(page, page.get_by_role("button", name="as it prints").click)
    watched.picture("mend")
    page.get_by_role("button", name="Cut a wall").click()
    cut = page.get_by_test_id("cut")
    expect(cut.get_by_role("img", name=re.compile(r"^[1-9]\d* beads cut at Y"))).to_be_visible()
    for kind, begins in (("PNG", b"\x89PNG"), ("SVG", b"<svg")):
        with page.expect_download() as load:
            cut.get_by_role("button", name=f"Save as {kind}").click()
        assert Path(load.value.path()).read_bytes().startswith(begins)
    page.get_by_role("link", name="Prove").click()
    page.get_by_role("button", name="Make the check print").click()
    with page.expect_download() as load:
        page.get_by_role("link", name="Download the check print").click()
    (check := tmp_path / "check.gcode").write_bytes(Path(load.value.path()).read_bytes())
    printed = plan.waypoints_mm.copy()
    printed[plan.rows] = _dots(print_gcode(check, twin).measured_mm, plan.marks_mm)
    page.set_input_files("input[type=file][accept*=csv]", _scan(tmp_path / "check.png", printed, plan_path, 2))
    page.wait_for_selector("text=Update the model with this measurement")
    page.reload()  # check print and verdict are there again
    expect(page.get_by_role("link", name="Download the check print")).to_be_visible()
    expect(page.get_by_role("heading", name="The promise was kept")).to_be_visible()
    # What keeps its promise is of this machine.
    expect(page.get_by_text("does not match the old model")).to_have_count(0)
    page.get_by_role("button", name="Update the model").click()
    page.wait_for_selector("text=Updated. Mend your parts")
    watched.picture("prove")
    page.get_by_role("link", name="My printers").click()
    mine = page.locator("a.pcard", has=page.get_by_role("heading", name=name, exact=True))
    expect(mine).to_contain_text(re.compile("the frame is not square", re.IGNORECASE))
    expect(mine.locator(".mpart.bad")).not_to_have_count(0)
    assert page.title() == "My printers – printmend"
    watched.picture("printers")
    _ok(watched)


def _dots(places_mm: np.ndarray, marks_mm: np.ndarray) -> np.ndarray:
    """Return where the nozzle stood for each dot: at the last place near it before it went on to the next one."""
    found, at = np.empty_like(marks_mm), 0
    for number, mark in enumerate(marks_mm):
        while np.hypot(*(places_mm[at] - mark)) > NEAR_MM:
            at += 1
        while at + 1 < len(places_mm) and np.hypot(*(places_mm[at + 1] - mark)) <= NEAR_MM:
            at += 1
        found[number] = places_mm[at]
    return found


def test_broken_to_mended_on_the_play_screen(browser: Browser, server: Server) -> None:
    watched = _page(browser, server, device_scale_factor=1.5)
    page = watched.page
    page.add_init_script(  # what phones have
        "navigator.canShare = () => true; navigator.share = async ({ files: [card] }) => { window.sent = card.size; }"
    )
    page.goto(server.address)
    page.wait_for_selector("#drawing")
    before = page.locator("#drawing path").nth(1).get_attribute("d")
    page.get_by_role("button", name="Squeezed pulley").click()
    until(lambda: page.locator("#drawing path").nth(1).get_attribute("d") != before)
    page.get_by_role("button", name="A bad day").click()
    until(lambda: page.locator("#drawing path").nth(1).get_attribute("d") == before)
    watched.picture("play-broken")
    page.get_by_role("button", name="Mend it").click()
    page.wait_for_selector("[data-testid=part]")
    expect(page.locator(".number b[data-still=true]")).to_have_count(2)  # counted down
    off = [float(text.split()[0]) for text in page.locator(".number b").all_inner_texts()[:2]]
    assert off[1] < 0.05 < 0.3 < off[0], off
    expect(page.get_by_role("heading", name="X pulley is off its centre")).to_be_visible()
    until(lambda: page.locator("canvas").get_attribute("data-frame"))
    handle = page.get_by_role("slider", name="Compare as it prints with mended")
    until(lambda: handle.get_attribute("aria-valuenow") == "50")
    handle.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "54")
    machine = page.get_by_role("group", name=re.compile("^Your printer"))
    page.locator("[data-fault=x]").first.hover()  # a sentence lights its part, and a part its sentences
    expect(machine.locator("[data-part=x]")).to_have_class(re.compile("lit"))
    machine.locator("[data-part=y]").focus()
    expect(page.locator("[data-fault=y]").first).to_have_class(re.compile("lit"))
    drawn_finely(page, lambda: handle.press("ArrowLeft"))
    drawn, legend = (page.locator(f"[data-testid=part] {one}").bounding_box() for one in ("canvas", ".under"))
    assert drawn["y"] + drawn["height"] <= legend["y"] + 1  # nothing of the part is under its legend
    watched.picture("play-mended")
    share = page.get_by_role("button", name="Share")
    page.set_viewport_size({"width": 390, "height": 844})  # a phone shows what comes next without scrolling
    page.evaluate("scrollTo(0, 0)")
    for one in (share, handle, page.get_by_text("times better")):
        expect(one).to_be_in_viewport()
    share.click()
    shown = page.get_by_role("dialog")
    with page.expect_download() as load:
        shown.get_by_role("button", name="Save as PNG").click()
    shown.get_by_role("button", name="Send it").click()
    until(lambda: page.evaluate("window.sent") == Path(load.value.path()).stat().st_size)
    card, _ = read_image(Path(load.value.path()))
    assert card.shape[:2] == (1260, 2400)
    halves = [card[220:900, :1190].reshape(-1, 3).astype(float), card[220:900, 1210:].reshape(-1, 3).astype(float)]
    red = [(half[:, 2] > half[:, 0] + 60).mean() for half in halves]
    assert red[0] > 0.02 > 10 * red[1]  # what is far off is red, and is not in the mended half
    sides = np.concatenate([card[220:900, at] for at in (0, 1180, 1220, 2399)]).astype(int)
    assert np.ptp(sides, axis=-1).max() < 30  # grey: the whole part is in it
    page.get_by_role("button", name="Close").click()
    page.set_viewport_size({"width": 1280, "height": 860})
    drawn_finely(page, page.get_by_role("button", name="as it prints").click)
    with page.expect_download() as load:
        page.get_by_role("button", name="Save as PNG").click()
    assert Path(load.value.path()).read_bytes()[:4] == b"\x89PNG"
    with page.expect_download() as load:
        page.get_by_role("button", name="Save as SVG").click()
    drawn = ElementTree.parse(load.value.path()).getroot()  # noqa: S314 - our own page's
    beads = [one for one in drawn if "stroke-width" in one.attrib and one.get("stroke", "").startswith("rgb")]
    assert len(beads) > 1000
    assert len({one.get("stroke") for one in beads}) > 20  # coloured by error, and lit
    _ok(watched)


def test_a_cut_shows_each_bead_at_its_width(browser: Browser, server: Server) -> None:
    """A bead that is cut at a slant shows a longer bar; one that ends before the cut its round end."""
    watched = _page(browser, server)
    watched.page.goto(server.address)
    # of the first point the last number says: joined, 0.5 mm wide, 0.2 mm high
    cut = """(wanted) => import("/cut.js").then((cut) => cut.beads({
        points: 2, unit_mm: 0.002, low_mm: [0, 0, 0], step_mm: [0.001, 0.001, 0.001], mended: null,
        base: new Uint16Array([...wanted.slice(0, 3), 10.341, ...wanted.slice(3), 0].map((v) => Math.round(1000 * v))),
        raw: new Int16Array([100, 0, 100, 0, 100, 0, 100, 0]),
    }, 1, 1, 10))"""

    def beads(*wanted: float) -> np.ndarray:
        return np.array(watched.page.evaluate(cut, list(wanted)))

    half = 0.25 / np.cos(np.radians(45))  # printed 0.2 mm to the right of where it was wanted
    assert beads(5, 0, 1, 25, 20, 1) == pytest.approx(np.array([[15.2 - half, 15.2 + half, 1, 0.2, 0.1]]), abs=1e-4)
    assert beads(5, 10, 1, 25, 10, 1) == pytest.approx(np.array([[4.95, 25.45, 1, 0.2, 0.1]]), abs=1e-4)
    assert beads(5, 0, 1, 5, 9.85, 1) == pytest.approx(np.array([[5.0, 5.4, 1, 0.2, 0.1]]), abs=1e-4)
    assert beads(5, 0, 1, 5, 9.7, 1).size == 0
    _ok(watched)


def test_colours_show_what_a_prediction_does_not_know(browser: Browser, server: Server) -> None:
    """Beside what the model says of a place, which is 0.03 mm as printed here and nothing once it is mended."""
    watched = _page(browser, server)
    watched.page.goto(server.address)
    found = watched.page.evaluate("""() => import("/scene.js").then(({ errorOf, scaleOf }) => {
        const part = { raw: [0, 0, 30, 0], mended: [0, 0, 0, 0], doubt: [0.04, 0.02], p95_mm: 0.06, left_mm: 0 };
        const { most, fine } = scaleOf(part);
        return [...[0, 1, 2].map((morph) => errorOf(part, morph)(0)), most, fine];
    })""")
    assert found == pytest.approx([0.0, 0.05, 0.02, 0.1, 0.02])
    _ok(watched)


# Each screen, and what it shows last: then all of it is there.
PLACES = {
    "": "#drawing", "#/printers": ".pcard", "#/printers/new": "button.primary:enabled",
    "#/printers/KEY/measure": "#plate", "#/printers/KEY/wrong": "#curve-Y",
    "#/printers/KEY/mend": "canvas[data-fine=true]", "#/printers/KEY/prove": ".numbers",
}  # fmt: skip


NARROWER = {390: (360,), 1280: (768, 360)}


def test_a_printer_with_nothing_to_mend_is_shown_so(browser: Browser, server: Server, tmp_path: Path) -> None:
    """Nothing is called larger or mended; a measurement that is refused is no sound printer's, in German too."""
    studio = Studio(server.address)
    key = studio.post("/printers", {"preset": "ender3", "name": _free_name(server, "Sound")})["id"]
    kept = server.folder / "printers" / key / "printer.mend.json"
    sound = exact_model(Twin.of(Corruption((Drive(), Drive())), PRINTER).homed())
    write_model(kept, sound)
    (source := tmp_path / "part.gcode").write_bytes(part(2))
    done = studio.wait(studio.post(f"/printers/{key}/mend", {"upload": studio.upload(source)})["id"])
    assert done["untouched"]
    watched = _page(browser, server, locale="de-DE")
    page = watched.page
    page.goto(f"{server.address}#/printers/{key}/mend")
    expect(page.get_by_text("Nichts zu korrigieren")).to_be_visible()
    expect(page.get_by_text("Abweichung korrigiert")).to_have_count(0)
    page.goto(f"{server.address}#/printers/{key}/wrong")
    expect(page.get_by_text("Kein Fehler, den ein Druck zeigen würde.")).to_be_visible()
    expect(page.get_by_text("größer", exact=False)).to_have_count(1)  # what the screen is for
    grew = together("; ", [say("grew-mm-end-end-while-print", *each) for each in (("X", "+0.32"), ("Y", "+0.31"))])
    found = [{"kind": "thermal", "severity": "refusal", "size_mm": 0.1, "evidence": 20.0, "words": grew}]
    document = {**sound.document, "misfit": {"found": found}, "messages": messages_of(found)}
    write_model(kept, replace(sound, document=document))
    page.reload()
    expect(page.get_by_text(translated(grew, GERMAN))).to_be_visible()
    expect(page.get_by_text("Kein Fehler, den ein Druck")).to_have_count(0)
    expect(page.get_by_role("link", name="Weiter: noch einmal messen")).to_be_visible()
    expect(page.get_by_text("Aus einer abgelehnten Messung")).to_be_visible()
    _ok(watched)


def test_a_message_is_german_by_its_id_however_its_english_is_worded(browser: Browser, server: Server) -> None:
    watched = _page(browser, server, locale="de-DE")
    watched.page.goto(server.address)
    said, why, turned = watched.page.evaluate("""async () => {
        const { heed, said, why } = await import("/words.js");
        const todo = { id: "scan-printed-side", values: {} };
        const least = { id: "least-measured-points", values: { a: "12" } };
        const whole = { id: "why", values: { a: "scan.png", b: "half of them", c: "3.5", d: "scan it all" } };
        heed({ jobs: [{ result: { messages: { "scan it all": todo, "half of them": least, "all of it": whole } } }] });
        heed({ messages: { "turned": { id: "", values: { a: "−0.5°" } } } });
        return [said("scan it all"), why("all of it"), said("turned")];
    }""")
    assert said == "Die bedruckte Seite scannen"
    assert why == f"scan.png: erwartet: mindestens 12 gemessene Punkte; gefunden: 3,5. {said}."
    assert turned == "−0,5°"
    _ok(watched)


@pytest.mark.parametrize(
    ("width", "height", "dark", "language"),
    [(390, 844, True, "en-GB"), (1280, 800, False, "de-DE"), (2560, 1440, True, "en-GB")],
)
def test_every_screen_fits_and_is_usable_by_all(
    browser: Browser, server: Server, known: str, width: int, height: int, dark: bool, language: str
) -> None:
    """No screen is wider than the window, axe finds nothing serious, and the page speaks the reader's language."""
    watched = _page(
        browser, server, viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light",
        locale=language,
    )  # fmt: skip
    page = watched.page
    for place, last in PLACES.items():
        page.goto(server.address + place.replace("KEY", known))
        page.locator(last).first.wait_for()
        _fits(page, place)
        assert page.evaluate("document.documentElement.lang") == language[:2]
        name = (place.split("/")[-1] or "play").replace("#", "")
        watched.picture(f"{width}-{name}", whole=width < 1000)
        found = Axe().run(page).response["violations"]
        serious = [(one["id"], [node["html"][:120] for node in one["nodes"]][:3]) for one in found
                   if one["impact"] in ("serious", "critical")]  # fmt: skip
        assert serious == [], place
        for narrower in NARROWER.get(width, ()):  # the same screen in a smaller window, in both languages
            page.set_viewport_size({"width": narrower, "height": height})
            _fits(page, (place, narrower))
        page.set_viewport_size({"width": width, "height": height})
    _ok(watched)


def test_the_keyboard_is_enough(browser: Browser, server: Server, known: str) -> None:
    watched = _page(browser, server)
    page = watched.page
    page.goto(server.address + f"#/printers/{known}/mend")
    page.wait_for_selector("[data-testid=part] canvas")
    until(lambda: page.locator("canvas").get_attribute("data-frame"))
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.tagName + ' ' + (document.activeElement.type ?? '')"))
        if page.evaluate("document.activeElement.tagName") == "CANVAS":
            break
    assert {"INPUT file", "A ", "BUTTON submit", "CANVAS "} <= reached, reached
    layer = page.get_by_text(re.compile(r"Layer \d+ of \d+"))
    last = layer.inner_text()
    page.keyboard.press("PageDown")
    until(lambda: layer.inner_text() != last)
    for key in ("ArrowLeft", "ArrowUp", "+", "-", "PageUp"):
        page.keyboard.press(key)
    until(lambda: layer.inner_text() == last)
    page.goto(server.address)
    page.wait_for_selector("#drawing")
    slider = page.get_by_label("How far out of shape").first
    slider.focus()
    page.keyboard.press("Home")
    until(lambda: slider.input_value() == "0")
    _ok(watched)


def test_what_goes_wrong_is_said_in_one_line(browser: Browser, server: Server, tmp_path: Path) -> None:
    watched, key = _page(browser, server), _measured(server, "Unlucky")
    page = watched.page
    Studio(server.address).post(f"/printers/{key}/probe", {"size_mm": 60})
    page.goto(server.address + f"#/printers/{key}/mend")
    (strange := tmp_path / "holiday.gcode").write_text("this is no G-code\n")
    alert = page.locator("[role=alert]").first
    page.route("**/api/v1/uploads*", lambda route: None)  # a way to the server that takes for ever
    page.set_input_files("input[type=file][accept*=gcode]", strange)
    page.get_by_role("button", name="Stop").click()
    expect(alert).to_have_text("Stopped")
    page.unroute("**/api/v1/uploads*")
    page.set_input_files("input[type=file][accept*=gcode]", strange)
    expect(alert).to_contain_text("holiday.gcode: expected")
    page.goto(server.address + f"#/printers/{key}/measure")
    (strange := tmp_path / "cat.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing more")
    page.set_input_files("input[type=file][accept='image/*']", strange)
    expect(alert).to_contain_text("cat.png")
    page.goto(server.address + "#/printers/new")
    expect(page.get_by_role("button", name="Add it")).to_be_visible()
    (strange := tmp_path / "printer.cfg").write_text(
        "[stepper_x]\nrotation_distance: round\n[printer]\nkinematics: cartesian\n"
    )
    page.set_input_files("input[type=file][accept*=cfg]", strange)
    page.get_by_role("button", name="Add it").click()
    expect(alert).to_have_text(re.compile(r"^\s*printer\.cfg: expected"))
    page.goto(server.address + f"#/printers/{key}/wrong")
    other = Studio(server.address).post("/printers", {"preset": "ender3", "name": _free_name(server, "Lucky")})["name"]
    for name, said in ((other, 1), (_free_name(server, "Renamed"), 0)):  # what works takes the message's place
        if not page.get_by_label("Name", exact=True).is_visible():
            page.get_by_role("button", name="Rename").click()
        page.get_by_label("Name", exact=True).fill(name)
        page.keyboard.press("Enter")
        expect(page.get_by_role("alert")).to_have_count(said)
    expect(page.get_by_role("heading", name=name)).to_be_visible()
    page.goto(server.address)
    page.get_by_role("button", name="Mend it").click()
    page.get_by_role("button", name="Stop").click()
    page.wait_for_selector("button:has-text('Mend it')")
    assert watched.foreign == []
    page.context.close()  # the browser notes each answer of 400 as an error of the page, rightly


def test_tabs_share_one_stream_of_events(browser: Browser, server: Server, tmp_path: Path) -> None:
    """A browser opens six connections to a server; with a stream each, the seventh tab would wait."""
    (source := tmp_path / "part.gcode").write_bytes(part(2))
    studio, context = Studio(server.address), browser.new_context(locale="en-GB")
    pages = [Watched(context.new_page(), server.address) for _ in range(8)]
    for k, watched in enumerate(pages):
        key = _measured(server, f"Tab {k}")
        studio.post(f"/printers/{key}/mend", {"upload": studio.upload(source)})
        watched.page.goto(server.address + f"#/printers/{key}/mend")
    for watched in pages:
        expect(watched.page.get_by_role("link", name="Download mended")).to_be_visible()
        asked = watched.page.evaluate("performance.getEntriesByType('resource').map((one) => one.name)")
        assert not [one for one in asked if one.endswith("/events")]
        assert (watched.problems, watched.foreign) == ([], [])
    context.close()


def test_of_several_files_each_has_its_own_fate(browser: Browser, server: Server, tmp_path: Path) -> None:
    """One is mended, one is for a larger bed and mended all the same, one is no G-code and is taken off the list."""
    watched, key = _page(browser, server), _measured(server, "Three at once")
    page = watched.page
    late: list[Route] = []
    # what was there before is told only after the drop
    page.route("**/api/v1/jobs?printer=*", lambda route: late.append(route), times=1)
    page.goto(server.address + f"#/printers/{key}/mend")
    large = part(1) + b"; bed_shape = 0x0,300x0,300x300,0x300\n; layer_height = 0.2\n"
    texts = {"good.gcode": part(1), "large.gcode": large, "holiday.gcode": b"no G-code\n"}
    for name, text in texts.items():
        (tmp_path / name).write_bytes(text)
    page.set_input_files("input[type=file][accept*=gcode]", [tmp_path / name for name in texts])
    rows, alert = page.locator(".file"), page.get_by_role("alert")
    load = page.get_by_role("link", name="Download mended")
    expect(rows.first).to_be_visible()
    late[0].continue_()
    expect(rows).to_have_count(3)
    expect(rows.filter(has_text="Not mended")).to_have_count(2)
    expect(load).to_have_attribute("download", "good.mended.gcode")  # the first is shown
    rows.filter(has_text="large.gcode").get_by_role("button", name="Not mended").click()
    expect(alert).to_contain_text("large.gcode: expected G-code for a bed from (0, 0) to (220, 220) mm")
    page.get_by_role("button", name="Mend it anyway").click()
    expect(load).to_have_attribute("download", "large.mended.gcode")
    expect(rows.filter(has_text="Not mended")).to_have_count(1)
    page.get_by_role("button", name="Remove holiday.gcode from the list").click()
    expect(rows).to_have_count(2)
    page.reload()
    expect(load).to_have_attribute("download", "large.mended.gcode")  # the newest
    expect(rows).to_have_count(2)
    _ok(watched)


def test_every_way_to_measure_fits_a_small_window_and_is_there_again(browser: Browser, server: Server) -> None:
    watched, key = _page(browser, server), _measured(server, "Small window")
    page = watched.page
    Studio(server.address).post(f"/printers/{key}/probe", {"size_mm": 60})
    page.goto(server.address + f"#/printers/{key}/measure")
    page.locator("#plate").wait_for()  # a test print that was made before this page was opened
    page.get_by_role("button", name="Table").click()
    page.get_by_role("button", name="Make the tower").click()
    page.get_by_role("link", name="Download the tower").wait_for()
    page.reload()
    for width in (360, 768):
        page.set_viewport_size({"width": width, "height": 800})
        for way, last in (("Callipers", "label.field svg"), ("Table", "text=Download the tower"), ("Scan", ".drop")):
            page.get_by_role("button", name=way).click()
            page.locator(last).first.wait_for()
            _fits(page, (way, width))
            watched.picture(f"{width}-measure-{way.lower()}", whole=True)
    _ok(watched)


def test_fifty_at_once_and_killed_in_the_middle(browser: Browser, tmp_path: Path) -> None:
    """All are answered and none is lost, though the power fails while they run; the page finds its way back."""
    one = Server(tmp_path / "studio")
    try:
        studio = Studio(one.address)
        key = studio.post("/printers", {"preset": "ender3", "name": "Farm"})["id"]
        write_model(one.folder / "printers" / key / "printer.mend.json", exact_model(Twin.of(FAULTS, PRINTER).homed()))
        for number in range(50):
            (tmp_path / f"{number}.gcode").write_bytes(part(1).replace(b"G28", b"; part %d\nG28" % number, 1))

        def send(number: int) -> str:
            return studio.post(f"/printers/{key}/mend", {"upload": studio.upload(tmp_path / f"{number}.gcode")})["id"]

        with ThreadPoolExecutor(50) as many:
            jobs = list(many.map(send, range(50)))
        assert len(set(jobs)) == 50
        watched = _page(browser, one)
        watched.page.goto(one.address + f"#/printers/{key}/mend")
        until(lambda: sum(job["state"] == "done" for job in studio.get("/jobs")) >= 3)
        most = one.memory_bytes()
        half = http.client.HTTPConnection("127.0.0.1", one.port)
        half.putrequest("POST", "/api/v1/uploads?name=half.gcode")
        half.putheader("Content-Length", "2000000")
        half.endheaders(part(1))
        until(lambda: list((one.folder / "uploads").glob(".*.tmp")))
        one.kill()
        half.close()
        away = watched.page.get_by_text("The studio does not answer")
        expect(away).to_be_visible()
        one.start()
        expect(away).to_be_hidden()
        for number, job in enumerate(jobs):
            result = studio.wait(job)
            assert result["name"] == f"{number}.gcode"
            studio.fetch(job, result["output"], tmp_path / "out.gcode")
            assert b"; part %d\n" % number in (tmp_path / "out.gcode").read_bytes()
            most = max(most, one.memory_bytes())
        assert most < 1.5e9
        for place in (one.folder / "uploads").iterdir():
            assert re.fullmatch(r"[0-9a-f]{16}", place.name), place
        assert not list(one.folder.rglob("*.tmp"))
        watched.page.wait_for_selector("text=Download mended")
        assert watched.foreign == []
        watched.page.context.close()
    finally:
        one.stop()


def test_storage_is_freed_in_a_dialog_of_the_pages_own(browser: Browser, server: Server, known: str) -> None:
    watched = _page(browser, server, reduced_motion="reduce")
    page = watched.page
    page.goto(f"{server.address}#/storage")
    mended = page.locator(".stored", has=page.get_by_role("heading", name="Mended files"))
    before = mended.locator("b").inner_text()
    assert before != "0.0 MB"
    mended.get_by_role("button", name="Free this").click()
    asked = page.get_by_role("dialog")
    expect(asked).to_contain_text("This cannot be undone.")
    page.keyboard.press("Escape")
    expect(asked).to_have_count(0)
    assert mended.locator("b").inner_text() == before
    _ok(watched)
