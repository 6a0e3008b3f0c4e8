"""The kernels that were compiled since the program started."""

import time


class Compilations:
    """How many entries were compiled, in how many seconds.

    Says once why nothing happens for a while. Kernels are compiled when they are first used on a machine.
    """

    def __init__(self) -> None:
        self.entries, self.seconds = 0, 0.0
        self._began: list[float] = []  # an entry's functions are compiled within it

    def begin(self) -> None:
        if not self.entries and not self._began:
            import logging

            logging.getLogger(__name__).info(
                "compiling for this machine, this one time: up to 30 s (`printmend warm` does it beforehand)"
            )
        self._began.append(time.perf_counter())

    def end(self) -> None:
        took_s = time.perf_counter() - self._began.pop()
        if not self._began:
            self.entries, self.seconds = self.entries + 1, self.seconds + took_s


compilations = Compilations()
