"""Take the pictures of the studio that `make integrations` left in build/studio into docs/figures, in 256 colours."""

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("play-broken", "play-mended", "printers", "measure", "wrong", "mend", "prove")

for name in NAMES:
    picture = Image.open(ROOT / f"build/studio/{name}.png").convert("RGB")
    picture.quantize(256, dither=Image.Dither.NONE).save(ROOT / f"docs/figures/studio-{name}.png", optimize=True)
