"""A mend that is killed at any moment leaves the old file or the new one, never half of it."""

import random
import subprocess
import sys
import time
from pathlib import Path

from tests.mending import BENT, START, exactly

from printmend.model import write_model

KILLS = 6


def test_killed_in_place(tmp_path: Path) -> None:
    rows = b"".join(b"G1 X%d Y%d E1 F1800\n" % (60 + 7 * k % 97, 60 + 5 * k % 89) for k in range(12_000))
    original = START + rows
    source = tmp_path / "part.gcode"
    write_model(tmp_path / "printer.mend.json", exactly(BENT))
    command = [str(Path(sys.executable).parent / "printmend"), "mend", "--in-place", str(source)]
    command += ["-m", str(tmp_path / "printer.mend.json")]
    source.write_bytes(original)
    began = time.monotonic()
    subprocess.run(command, capture_output=True, check=True)  # noqa: S603 — our own program
    whole_s = time.monotonic() - began
    finished = source.read_bytes()
    assert finished != original
    rng, interrupted = random.Random(4), 0  # noqa: S311 — moments to kill at
    for share in (0.1, *(rng.uniform(0.2, 1.0) for _ in range(KILLS - 1))):  # the first run may have had to compile
        source.write_bytes(original)
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603 — our own
        time.sleep(share * whole_s)
        process.kill()
        process.wait()
        found = source.read_bytes()
        assert found in (original, finished)
        interrupted += found == original
    assert interrupted
