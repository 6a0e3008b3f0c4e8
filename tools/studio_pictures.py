"""Take the pictures of the studio into docs/figures, in 256 colours.

Those that `make integrations` left in build/studio, and those of a large part and of callipers, made here: run
`.venv/bin/python tools/studio_pictures.py`. Needs PrusaSlicer and Debian's Chromium.
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "integrations/tests"), str(ROOT / "benchmarks")]

from studio_server import PICTURES, Server, Watched, chromium, drawn_finely, until  # noqa: E402

from bench_studio import printer_of  # noqa: E402 - found on the path that is set above
from printmend.client import Studio  # noqa: E402
from studio_part import gear_gcode  # noqa: E402

NAMES = ("play-broken", "play-mended", "printers", "measure", "wrong", "mend", "cut", "callipers", "prove")


def take_others() -> None:
    """Mend a gear as owners print them, take it whole and cut open, and the form for callipers."""
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        (source := Path(name) / "herringbone gear.gcode").write_bytes(gear_gcode())
        server = Server(Path(name) / "studio")
        try:
            key = printer_of(server, "the old one")
            size = {"width": 1280, "height": 860}
            page = browser.new_context(viewport=size, locale="en-GB", device_scale_factor=1.5).new_page()
            watched = Watched(page, server.address)
            page.goto(f"{server.address}#/printers/{key}/mend")
            page.set_input_files("input[type=file][accept*=gcode]", source)
            page.wait_for_selector("text=Download mended", timeout=600_000)
            until(lambda: page.locator("canvas").get_attribute("data-frame"))
            drawn_finely(page, page.get_by_role("button", name="as it prints").click)
            watched.picture("mend")
            page.get_by_role("button", name="Cut a wall").click()
            page.get_by_test_id("cut").scroll_into_view_if_needed()
            page.get_by_test_id("cut").screenshot(path=str(PICTURES / "cut.png"))
            Studio(server.address).post(f"/printers/{key}/probe")
            page.goto(f"{server.address}#/printers/{key}/measure")
            page.reload()
            page.get_by_role("button", name="Callipers").click()
            page.get_by_label("Distance 1,").fill("146,25")
            watched.picture("callipers")
            assert watched.problems == []
        finally:
            server.stop()


take_others()
for one in NAMES:
    picture = Image.open(PICTURES / f"{one}.png").convert("RGB")
    picture.quantize(256, dither=Image.Dither.NONE).save(ROOT / f"docs/figures/studio-{one}.png", optimize=True)
