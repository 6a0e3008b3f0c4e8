"""How long uploads and segments take inside the programs that owners print with.

    make hosts
    .venv/bin/python benchmarks/bench_hosts.py

Moonraker: seconds from an upload's first byte until it is mended and its metadata are read. OctoPrint: seconds until an
upload is answered, and until its mended copy is there. The live transform for Klipper: microseconds of processor time
for a segment, in pure Python. Each is the best of a few, after one that warms up.
"""

import argparse
import importlib.util
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

TESTS = Path(__file__).resolve().parents[1] / "integrations/tests"
sys.path.insert(0, str(TESTS))

from hosts import INTEGRATIONS, wait_for  # noqa: E402 — beside the tests
from parts import part  # noqa: E402
from test_moonraker import moonraker_running  # noqa: E402
from test_octoprint import octoprint_running  # noqa: E402

from printmend.model.model import exact_model, write_model  # noqa: E402
from printmend.printer import read_printer  # noqa: E402
from printmend_lab.sampling import sample  # noqa: E402

SIZE_BYTES = 5_000_000


def moonraker_s(text: bytes, times: int) -> float:
    with moonraker_running() as host:
        host.upload("warm.gcode", part(1))
        found = []
        for k in range(times):
            begin = time.monotonic()
            host.upload(f"large{k}.gcode", text)
            metadata = f"/server/files/metadata?filename=large{k}.gcode"
            wait_for(lambda path=metadata: host.get(path)["printmend"]["state"] == "current", "the metadata")
            found.append(time.monotonic() - begin)
    return min(found)


def octoprint_s(text: bytes, times: int, folder: Path) -> tuple[float, float]:
    answered, copied = [], []
    with octoprint_running(folder) as host:
        for k in range(times + 1):
            begin = time.monotonic()
            host.upload(f"large{k}.gcode", text)
            answered.append(time.monotonic() - begin)
            copy = f"large{k}.mended.gcode"
            wait_for(lambda name=copy: host.told(name).get("state") == "current", "the copy")
            copied.append(time.monotonic() - begin)
    return min(answered[1:]), min(copied[1:])


def live_us(folder: Path) -> float:
    path = folder / "printer.mend.json"
    fault = sample("pulley-loose", np.random.default_rng(2))
    write_model(path, exact_model(fault.lower(read_printer("ender3"))))  # type: ignore[arg-type] — no gain table
    spec = importlib.util.spec_from_file_location("printmend_live", INTEGRATIONS / "klipper/printmend.py")
    live = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(live)
    planner, times, place = live.planner.Planner(live.read_model(path)), [], [20.0, 30.0, 0.2, 0.0]
    planner.home(7)
    made: list = []
    for _ in range(20):
        made.clear()
        begin = time.process_time()
        for i in range(300):
            x, y = 100 + 60 * np.cos(i / 20), 100 + 60 * np.sin(i / 20)
            to = [float(x), float(y), 0.2, place[3] + (0.1 if i else 0.0)]
            planner.add(place, to, 50.0)
            place = to
        planner.plan(300, lambda wanted, moves: made.extend(moves))
        times.append((time.process_time() - begin) / len(made))
    return 1e6 * min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=3)
    options = parser.parse_args()
    text = part(SIZE_BYTES // len(part(1)) + 1)
    print(f"{len(text) / 1e6:.1f} MB, {len(text.splitlines())} lines")
    with tempfile.TemporaryDirectory() as name:
        print(f"live transform      {live_us(Path(name)):8.1f} µs a command", flush=True)
        print(f"Moonraker ready     {moonraker_s(text, options.times):8.2f} s", flush=True)
        (folder := Path(name) / "octoprint").mkdir()
        answered, copied = octoprint_s(text, options.times, folder)
        print(f"OctoPrint answers   {answered:8.2f} s, mended copy after {copied:.2f} s", flush=True)


if __name__ == "__main__":
    main()
