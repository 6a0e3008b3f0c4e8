"""The server's connections: each must ask within a time, and one address may hold only so many.

uvicorn waits for ever for the end of a request's headers. So a few hundred connections that say nothing would keep
everybody else out.
"""

import asyncio
from collections import Counter
from typing import ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol

ASK_S = 10.0  # from the beginning of a connection, or of a further request on it, to the end of its headers
MOST_AN_ADDRESS = 128  # connections; a browser has six, and a proxy speaks for many
MOST_SILENT = 32  # connections of an address that have not asked yet


class Door(H11Protocol):
    """A connection of uvicorn's that ends where it does not ask in time. It extends uvicorn's own class, as its
    setting `http` takes a class and nothing smaller."""

    _open: ClassVar[Counter[str]] = Counter()
    _silent: ClassVar[Counter[str]] = Counter()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request, or refuse an address that holds too many connections."""
        super().connection_made(transport)
        self._late: asyncio.TimerHandle | None = None
        self._address = self.client[0] if self.client else ""
        self._open[self._address] += 1
        if self._open[self._address] > MOST_AN_ADDRESS or self._silent[self._address] >= MOST_SILENT:
            transport.abort()
            return
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Take what came; once the headers are whole nothing is waited for but the answer."""
        super().data_received(data)
        asked = self.cycle is not None and not self.cycle.response_complete
        if asked:
            self._stop_waiting()
        elif not self.transport.is_closing():
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._stop_waiting()
        self._open[self._address] -= 1
        if not self._open[self._address]:
            del self._open[self._address]
        super().connection_lost(exc)

    def _wait(self) -> None:
        if self._late is None:
            self._silent[self._address] += 1
            self._late = self.loop.call_later(ASK_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None
            self._silent[self._address] -= 1
            if not self._silent[self._address]:
                del self._silent[self._address]
