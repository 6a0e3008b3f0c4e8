"""Work that kills its worker; a module of its own, so that the workers of the test start quickly."""

import os


def dies_on_two(item: int) -> int:
    if item == 2:
        os._exit(1)
    return item * int(os.environ["OMP_NUM_THREADS"])
