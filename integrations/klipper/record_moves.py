# SPDX-License-Identifier: GPL-3.0-or-later
"""A plugin for Klippy that writes down what its look-ahead decided: one row of 15 doubles a planned move.

[record_moves] path: FILE, drain: SECONDS to wait at the end for the steps of the last moves. A row is the time of the
start, the seconds of acceleration, cruising and braking, the speeds at start, cruising and end, then x y z e at the
start and at the end (s, mm). benchmarks/klippy_run.py reads it.
"""

import struct

ROW = struct.Struct("=15d")


class RecordMoves:
    """Hang a callback on each move that leaves the look-ahead queue."""

    def __init__(self, config):
        self.printer = config.get_printer()
        self.drain_s = config.getfloat("drain", 0.1)
        self.file = open(config.get("path"), "wb")  # noqa: SIM115 — open as long as the program runs
        self.printer.register_event_handler("klippy:connect", self._connect)
        self.printer.register_event_handler("gcode:request_restart", self._drain)
        self.printer.register_event_handler("klippy:disconnect", self.file.close)

    def _connect(self):
        queue = self.printer.lookup_object("toolhead").lookahead
        flush = queue.flush

        def recorded(lazy=False):
            moves = flush(lazy=lazy) or []
            for move in moves:
                move.timing_callbacks.append(lambda end, move=move: self._write(end, move))
            return moves

        queue.flush = recorded

    def _drain(self, print_time):
        """Let the thread that writes the steps catch up: at the end of a batch what it has not written is lost."""
        self.printer.lookup_object("toolhead").flush_step_generation()
        reactor = self.printer.get_reactor()
        reactor.pause(reactor.monotonic() + self.drain_s)

    def _write(self, end_s, move):
        start_s = end_s - move.accel_t - move.cruise_t - move.decel_t
        times = (start_s, move.accel_t, move.cruise_t, move.decel_t)
        speeds = (move.start_v, move.cruise_v, move.end_v)
        self.file.write(ROW.pack(*times, *speeds, *move.start_pos[:4], *move.end_pos[:4]))


def load_config(config):
    return RecordMoves(config)
