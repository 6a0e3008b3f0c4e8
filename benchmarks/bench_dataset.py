"""How fast a data set is read back, a layer at a time.

    python benchmarks/bench_dataset.py FOLDER

Reads the largest layer of the largest body, and its print on printer 0, again and again; the best time counts, of the
processor. A layer takes less than a millisecond, and the first fifty reads of a process may all be a third slower than
later ones.
"""

import sys
import time
from pathlib import Path

from printmend_lab.dataset.parquet import BODIES, body_file, print_file, read_about, read_body, read_lines, read_print

SECONDS = 1.0  # of reading, each kind


def main(root: Path) -> None:
    line = max(read_lines(root / BODIES), key=lambda item: item["points"])
    body, printed = body_file(root, line["body"]), print_file(root, line["body"], 0)
    rows = [part["rows"] for part in read_about(body)["layers"]]
    group = max(range(len(rows)), key=rows.__getitem__)
    for name, read, path in (("body", read_body, body), ("print", read_print, printed)):
        for what, groups, count in (("one layer", [group], rows[group]), ("all layers", None, sum(rows))):
            best, started = float("inf"), time.process_time()
            while (begun := time.process_time()) < started + SECONDS:
                read(path, groups)
                best = min(best, time.process_time() - begun)
            print(f"{name}, {what}: {count} rows in {1e3 * best:.2f} ms, {count / best / 1e6:.1f} M rows/s")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
