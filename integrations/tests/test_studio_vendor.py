"""The libraries of the studio's page are those of the lock file: bundling them again gives the same bytes."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(shutil.which("npm") is None, reason="needs npm; the hash is compared by tests/test_studio.py")
def test_bundling_again_gives_the_same_bytes(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "tools/studio_vendor", tmp_path / "vendor", ignore=shutil.ignore_patterns("node_modules"))
    (out := tmp_path / "out").mkdir()
    subprocess.run([tmp_path / "vendor/build.sh", out], check=True, timeout=300)  # noqa: S603 - our own
    for name in ("vendor.js", "vendor.LICENSES.txt", "vendor.sha256"):
        assert (out / name).read_bytes() == (ROOT / "src/printmend/studio/page" / name).read_bytes(), name
