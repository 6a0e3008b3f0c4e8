"""Compile what learn, check and mend need into src/printmend/compiled, for the wheel or for this clone.

    .venv/bin/python tools/ship_kernels.py

What is there already and still fits its source is left alone; what fits no longer is removed.
"""

import os
import tempfile


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="printmend-") as empty:
        os.environ["NUMBA_CACHE_DIR"] = empty  # read when numba is imported
        from printmend.repair.warm import warm
        from printmend.shipped import shipped

        shipped.fill = True
        entries, seconds = warm(print)
        shipped.forget_others()
    size = sum(path.stat().st_size for path in shipped.folder.iterdir())
    print(f"{entries} compiled in {seconds:.0f} s; {len(shipped.used)} in {shipped.folder}: {size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
