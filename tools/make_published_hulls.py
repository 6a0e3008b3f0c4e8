"""Make src/printmend/corruption/published_hulls.toml from the authors' table of moment arms.

    python tools/make_published_hulls.py ../shared/corpus/hulls/authors_hulls.csv

The table (RenzoCab/Non-Circular-Pulleys, MIT) gives h at 1000 equal angles; the product carries the first
harmonics of the bare hulls only.
"""

import sys
from pathlib import Path

import numpy as np
import tomli_w

NAMES = ("ideal", "small", "line", "triangle", "square", "egg")
HARMONICS = 40


def main(table: Path) -> None:
    with table.open(encoding="utf-8") as lines:
        header = next(lines).strip().split(",")
        heights = np.loadtxt(lines, delimiter=",")
    hulls = {}
    for name in NAMES:
        spectrum = np.fft.rfft(heights[:, header.index(f"{name}_0_mm")]) / len(heights)
        hulls[name] = {
            "radius_mm": round(float(spectrum[0].real), 6),
            "cos_mm": [round(float(c), 6) for c in 2 * spectrum[1 : HARMONICS + 1].real],
            "sin_mm": [round(float(c), 6) for c in -2 * spectrum[1 : HARMONICS + 1].imag],
        }
    target = Path(__file__).parents[1] / "src/printmend/corruption/published_hulls.toml"
    note = "# Moment arms of the authors' printed pulleys as Fourier series\n"
    note += "# (RenzoCab/Non-Circular-Pulleys, MIT); made by tools/make_published_hulls.py.\n\n"
    target.write_text(note + tomli_w.dumps(hulls), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
