"""Random numbers that will not change: numpy keeps its streams only from one release to the next."""

import hashlib
from collections.abc import Sequence
from typing import TypeVar

Choice = TypeVar("Choice")


class Dice:
    """Draws from SHA-256 over a text and a counter."""

    def __init__(self, text: str) -> None:
        self._text, self._drawn = text, 0

    def uniform(self, low: float, high: float) -> float:
        """Return a number of [low, high)."""
        self._drawn += 1
        digest = hashlib.sha256(f"{self._text} {self._drawn}".encode()).digest()
        return low + (high - low) * (int.from_bytes(digest[:7], "big") / 2**56)

    def whole(self, low: int, high: int) -> int:
        """Return a whole number of low…high, both included."""
        return low + int(self.uniform(0.0, high - low + 1))

    def choice(self, items: Sequence[Choice]) -> Choice:
        return items[self.whole(0, len(items) - 1)]

    def chance(self, share: float) -> bool:
        """Return True in ``share`` of all cases."""
        return self.uniform(0.0, 1.0) < share
