"""Tag a wheel by what it holds: compiled kernels serve one Python on one kind of processor, the rest serves all.

`PRINTMEND_PURE=1` leaves the kernels out. `make dist` builds both wheels.
"""

import os
import platform
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

KERNELS = "src/printmend/compiled"


class CustomBuildHook(BuildHookInterface):
    """Put the library of `tools/ship_kernels.py` into the wheel, where there is one."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the kernels and the tag; an editable installation finds them beside the sources."""
        pure = os.environ.get("PRINTMEND_PURE", "") not in ("", "0")
        if version == "editable" or pure or not Path(self.root, KERNELS, "kernels.json").is_file():
            return
        build_data["artifacts"].append(f"{KERNELS}/kernels.*")
        build_data["pure_python"] = False
        build_data["tag"] = f"{sys.implementation.cache_tag.replace('cpython-', 'cp')}-none-{_platform()}"


def _platform() -> str:
    """Return the wheel's platform. The library of kernels needs the C library of this system, or a later one."""
    if sys.platform == "linux":
        return f"manylinux_{platform.libc_ver()[1].replace('.', '_')}_{platform.machine()}"
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")
