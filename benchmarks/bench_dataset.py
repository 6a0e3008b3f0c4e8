"""How fast a data set is read back, a layer at a time.

    python benchmarks/bench_dataset.py FOLDER

Reads the largest layer of the largest body, and its print on printer 0, again and again; times are of the processor.
"""

import sys
import time
from pathlib import Path

from printmend.dataset.build import BODIES, body_file, print_file, read_lines
from printmend.dataset.parquet import read_about, read_body, read_print

REPEATS = 60


def main(root: Path) -> None:
    line = max(read_lines(root / BODIES), key=lambda item: item["points"])
    body, printed = body_file(root, line["body"]), print_file(root, line["body"], 0)
    rows = [part["rows"] for part in read_about(body)["layers"]]
    group = max(range(len(rows)), key=rows.__getitem__)
    for name, read, path in (("body", read_body, body), ("print", read_print, printed)):
        for what, groups, count in (("one layer", [group], rows[group]), ("all layers", None, sum(rows))):
            best = []
            for _ in range(REPEATS):
                begun = time.process_time()
                read(path, groups)
                best.append(time.process_time() - begun)
            print(f"{name}, {what}: {count} rows in {1e3 * min(best):.2f} ms, {count / min(best) / 1e6:.1f} M rows/s")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
