"""Draw the pictures of the owners' pages into docs/figures, by the commands that these pages name.

`.venv/bin/python tools/owner_pictures.py` draws all, in a few minutes; names draw single ones. The printer is
the broken one of docs/owners.md; its prints come from the twin, the parts, the photo and the ruler from
tests/foreign_layer.py, which shares no code with printmend.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from printmend.cli.calliper_talk import talk
from printmend.measure import read_plan

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from tests import foreign_layer as foreign  # noqa: E402 - found on the path that is set above

FIGURES = ROOT / "docs/figures"
WIDE_PX = 900
BROKEN = """[x.pulley]
kind = "eccentric"
eccentricity_mm = 0.3
phase_rad = 1.2

[x.belt]
kind = "play"
play_mm = 0.3

[y.belt]
kind = "play"
play_mm = 0.2
"""


def command(folder: Path, words: str) -> None:
    """Run a command of printmend in a folder."""
    run = [sys.executable, "-m", "printmend", *words.split()]
    subprocess.run(run, cwd=folder, check=True, stdout=sys.stderr)  # noqa: S603 - words of this file


def keep(picture: Path, name: str) -> None:
    """Keep a picture, as wide as a page shows it."""
    image = Image.open(picture).convert("RGB")
    if image.width > WIDE_PX:
        image = image.resize((WIDE_PX, round(image.height * WIDE_PX / image.width)), Image.Resampling.LANCZOS)
    target = FIGURES / name
    if name.endswith(".png"):
        image.save(target, optimize=True)  # a palette of 256 loses the colours that the legends name
    else:
        image.save(target, quality=80, optimize=True)
    print(target)


def page(folder: Path, options: str, name: str) -> None:
    """Write a test print and keep the upper part of its page: the pictures, the bed and the glass."""
    command(folder, f"probe {options} -o {name}.gcode")
    drawn = folder / name
    run = [str(shutil.which("pdftoppm")), "-r", "110", "-png", "-singlefile", f"{name}-how-to.pdf", name]
    subprocess.run(run, cwd=folder, check=True)  # noqa: S603 - words of this file
    with Image.open(drawn.with_suffix(".png")) as image:
        image.crop((60, 70, image.width - 60, round(0.487 * image.height))).save(folder / "cut.png")
    keep(folder / "cut.png", f"{name}.png")


def paper(folder: Path) -> None:
    """A sheet drawn with a pen, as measure saw it; with a ruler beside it."""
    command(folder, "probe --printer ender3 --pen -o sheet.gcode")
    command(folder, "twin sheet.gcode --printer ender3 --corruption broken.toml --dpi 200 --scan scan.jpg -o exact.csv")
    command(folder, "measure scan.jpg --probe sheet.json --dpi 200 -o trace.csv --overlay seen.jpg")
    keep(folder / "seen.jpg", "paper-seen.jpg")
    scan = (folder / "scan.jpg").read_bytes()
    (folder / "ruled.jpg").write_bytes(foreign.with_ruler(scan, 1.0, stretch=1e-3, length=150.0))
    command(folder, "measure ruled.jpg --probe sheet.json --dpi 200 -o trace.csv --overlay seen.jpg")
    with Image.open(folder / "seen.jpg") as image:  # the ruler lies below
        image.crop((0, image.height // 2, image.width, image.height)).save(folder / "lower.jpg", quality=95)
    keep(folder / "lower.jpg", "ruler-seen.jpg")


def part(folder: Path) -> None:
    """The underside of a part, as measure saw it."""
    (folder / "part.gcode").write_text(foreign.gcode(foreign.gear(), layers=3)[0])
    command(folder, "twin part.gcode --printer ender3 --corruption broken.toml --scan underside.png -o exact.csv")
    command(folder, "measure underside.png --gcode part.gcode --printer ender3 -o part.csv --overlay seen.jpg")
    keep(folder / "seen.jpg", "part-seen.jpg")


def photo(folder: Path) -> None:
    """A part on the sheet of tags, in a tilted photo of 12 megapixels, as measure saw it."""
    text, strokes = foreign.gcode(foreign.gear(), layers=3)
    (folder / "photographed.gcode").write_text(text)
    broken = foreign.Machine(waves=(((1, 0.3, 0.4),), ((1, 0.12, 1.0),)), play=(0.3, 0.2))
    seen = foreign.photo(broken.strokes(strokes), np.random.default_rng(1), size_px=(3000, 4000))
    (folder / "photo.jpg").write_bytes(seen)
    command(folder, "measure photo.jpg --gcode photographed.gcode --printer ender3 -o part.csv --overlay seen.jpg")
    keep(folder / "seen.jpg", "photo-seen.jpg")


def callipers(folder: Path) -> None:
    """The map of the first distance that `measure --callipers` asks for."""
    command(folder, "probe --printer ender3 -o plate.gcode --overwrite")
    plan = read_plan(folder / "plate.json")
    answers = iter(["q"])
    talk(plan, lambda _: next(answers), lambda _: None, picture=folder / "map.png")
    keep(folder / "map.png", "callipers-map.png")


def wear(folder: Path) -> None:
    """Play that grows from 0.03 to 0.13 mm, measured eight times with 0.05 mm of noise."""
    command(folder, "probe --printer ender3 --size 120 --dots 200 -o plate.gcode")
    for month in range(8):
        play_mm = 0.03 + 0.0143 * month
        (folder / "worn.toml").write_text(f'[x.belt]\nkind = "play"\nplay_mm = {play_mm}\n')
        command(
            folder, "twin plate.gcode --printer ender3 --corruption worn.toml --noise-mm 0.05 -o trace.csv "
            f"--seed {month}"
        )  # fmt: skip
        how = "--update printer.mend.json" if month else "--printer ender3"
        command(folder, f"learn trace.csv {how} -o printer.mend.json --date 2026-{month + 1:02d}-15")
    command(folder, "history printer.mend.json --picture wear.png")
    keep(folder / "wear.png", "wear.png")


def main() -> None:
    """Draw what is named, or all."""
    pages = {
        "paper-page": "--printer ender3 --on paper", "pen-page": "--printer ender3 --pen",
        "paper-sheets": "--printer cr10s --on paper --sheets 2", "net-page": "--printer ender3 --net --size 150",
    }  # fmt: skip
    ways = {"paper": paper, "part": part, "photo": photo, "callipers": callipers, "wear": wear}
    wanted = sys.argv[1:] or [*pages, *ways]
    if shutil.which("pdftoppm") is None:
        sys.exit("pdftoppm is missing: apt-get install poppler-utils")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "broken.toml").write_text(BROKEN)
        for one in wanted:
            if one in pages:
                page(folder, pages[one], one)
            else:
                ways[one](folder)


if __name__ == "__main__":
    main()
