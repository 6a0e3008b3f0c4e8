# SPDX-License-Identifier: GPL-3.0-or-later
"""Moves that are wanted into moves that are commanded, a stretch at a time: `printmend mend` without a file.

A move is told as Klipper has it, from one place [x y z e …] to the next. It waits until the path that it belongs to is
whole: only then is it known where the motors turn back, and where there is room to cross their slack.
"""

import importlib.util
import math
import os

HERE = os.path.dirname(os.path.realpath(__file__))
STILL_MM = 1e-7
QUANTUM_MM = 0.001  # of commands, as `printmend mend` writes them
MOST_WAITING = 512  # moves of one path: a longer one is begun before its end is seen
AHEAD = 128  # moves that are seen ahead then
ROOM = 1 << 30
X_Y, Z_BIT = 3, 4


def beside(name):
    """Return a module of this folder."""
    spec = importlib.util.spec_from_file_location("printmend_live_" + name, os.path.join(HERE, name + ".py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


kernels, tables = beside("kernels"), beside("tables")


class Wanted:
    """A move that waits: its record, from and to where it goes, and what its owner wants to have back with it."""

    __slots__ = ("arc", "begin", "end", "note", "record", "speed")

    def __init__(self, record, begin, end, speed, note, arc):
        self.record, self.begin, self.end, self.speed, self.note, self.arc = record, begin, end, speed, note, arc


class Pieces:
    """Where `mend` puts its pieces. Before each record it asks for their room: there they are handed on."""

    def __init__(self, kind, before_record):
        self.kind, self.before_record = kind, before_record
        self.made, self.count = [], 0

    def __len__(self):
        return ROOM if self.before_record() else 0

    def __getitem__(self, n):
        while len(self.made) <= n:
            self.made.append(self.kind.one())
        self.count = max(self.count, n + 1)
        return self.made[n]


class Planner:
    """What is known of the belts of one machine, and the moves that wait."""

    def __init__(self, document, tolerance_mm=tables.TOLERANCE_MM):
        self.kernels, self.mend = kernels.planner()
        load = self.kernels.load
        self.look, self.belts = (load("printmend.plan.kernels." + name) for name in ("lookup", "state"))
        self.height, self.layout = (load("printmend.plan.kernels." + name) for name in ("height", "layout"))
        self.text = load("printmend.gcode.kernels.layout")
        self.model, self.ripples = tables.model_of(document, self.kernels, tolerance_mm)
        self.model.head.crossing = document["printer"].get("limits", {}).get("crossing_mm_s2", 0.0)
        self.pulses = ((), ())
        self.state, self.counts = self.layout.STATE.one(), self.layout.COUNTS.one()
        self.curves = load("printmend.plan.kernels.curve")
        self.curve, self.has_screw = self.curves.CURVE.one(), bool(self.model.head.screw)
        self.moved = self.curves.CURVE.one() if self.has_screw else None
        self.piece = self.curves.CURVE.one()
        self.run, self.layers = self.layout.RUN.one(), [self.layout.LAYER.one()]
        self.counts.known = self.counts.height = 1
        text = self.text
        self.flags = (text.FLAG_KNOWN_X0 | text.FLAG_KNOWN_Y0 | text.FLAG_KNOWN_Z0
                      | text.FLAG_KNOWN_X1 | text.FLAG_KNOWN_Y1 | text.FLAG_KNOWN_Z1
                      | text.TELL_S << text.TELL_SHIFT)  # fmt: skip
        self.waiting = []

    def shape(self, pulses):
        """Note the pulses [s, share] of the input shaper of x and of y, of which walls' speed makes up for."""
        if pulses != self.pulses:
            self.pulses = pulses
            tables.put_shaper(self.model.head, self.ripples, pulses)

    def home(self, axes):
        """Note that the end stops of ``axes`` (bits of x, y, z) were met: the homing direction's branch is engaged."""
        head, mended = self.model.head, self.state.mended
        if axes & X_Y:
            self.belts.settle_home(self.model, mended, axes & X_Y, *head.home)
        if axes & Z_BIT and self.has_screw:
            self.height._settle_home(self.model, mended, head.z_home)

    def drag(self, x, y, z):
        """Follow motors that somebody else moved: they are where (x, y, z) is commanded."""
        mended = self.state.mended
        motors = self.look.to_motors(self.model, x, y)
        motors = [at if abs(at - m) <= STILL_MM else m for at, m in zip(mended.m, motors)]
        self.belts.arrive(self.model, self.state, *motors)
        if self.has_screw and abs(z - mended.m[2]) > STILL_MM:
            self.height.lift(self.model, self.state, z)

    def commanded(self, z):
        """Return where the motors are, as a place; its height is ``z`` where Z is as designed."""
        mended = self.state.mended
        x, y = self.look.from_motors(self.model, mended.m[0], mended.m[1])
        return x, y, mended.m[2] if self.has_screw else z

    def place(self, z):
        """Return where the nozzle is."""
        middle, dx, dy = self.belts.middle, 0.0, 0.0
        x, y = self.look.printed(self.model, middle(self.state, 0), middle(self.state, 1))
        if self.has_screw:
            dx, dy = self.height.push(self.model, self.state.mended.m[2])
            z = middle(self.state, 2)
        return x + dx, y + dy, z

    def add(self, begin, end, speed, note=None, arc=None, accel=0.0):
        """Let a move wait; return how many of those that wait may be planned now, 0 where more must be seen.

        ``arc`` is a centre x, y, whether it goes clockwise, and the length of the chords that Klipper cuts. Ends that
        coincide make a full circle. ``accel`` [mm/s²] is that of the move, 0 where it is unknown.
        """
        text, r = self.text, self.text.RECORD.one()
        begin, end = [float(at) for at in begin], [float(at) for at in end]
        r.x0, r.y0, r.z0, r.e0 = begin[:4]
        r.x1, r.y1, r.z1, r.e1 = end[:4]
        r.kind, r.flags, r.feed, r.advance = text.KIND_LINEAR, self.flags, speed * 60.0, end[3] - begin[3]
        r.accel, r.next = accel, 1  # nothing else stands on its line
        if arc is not None:
            r.c0, r.c1 = arc[:2]
            r.kind = text.KIND_CW if arc[2] else text.KIND_CCW
        moves = arc is not None or r.x0 != r.x1 or r.y0 != r.y1
        r.words = (text.WORD_X | text.WORD_Y if moves else 0) | (text.WORD_Z if r.z0 != r.z1 else 0)
        r.words |= text.WORD_E if r.advance else 0
        if moves and r.advance > 0.0:  # comments do not come here: any line may be a wall that is seen
            r.flags |= text.FLAG_EXTRUDING | text.ROLE_OUTER << text.ROLE_SHIFT
        drew = bool(self.waiting) and self._draws(self.waiting[-1].record)
        self.waiting.append(Wanted(r, begin, end, speed, note, arc))
        if drew and not self._draws(r):
            return len(self.waiting) - 1
        return len(self.waiting) - AHEAD if len(self.waiting) >= MOST_WAITING else 0

    def _draws(self, record):
        return record.flags & self.text.FLAG_EXTRUDING

    def plan(self, count, put):
        """Plan about ``count`` of the moves that wait, and hand each to ``put(wanted, moves)`` with its moves."""
        waiting, asked = self.waiting, 0

        def hand_on():
            if asked:
                put(waiting[asked - 1], self._moves(waiting[asked - 1], at, pieces.made[given : pieces.count]))
            return pieces.count

        def before_record():
            nonlocal asked, given, at
            given = hand_on()
            # A path that is not yet whole is not left where a motor is on its way through its slack.
            if asked >= count and (asked >= len(waiting) - 1 or not self._is_crossing()):
                return False
            asked += 1
            at = self.commanded(waiting[asked - 1].begin[2])
            return True

        given, at, pieces = 0, None, Pieces(self.text.PIECE, before_record)
        records = [each.record for each in waiting]
        try:
            done = self.mend.mend(self.model, records, 0, len(records), self.state, self.counts, self.curve,
                                  self.moved, [0] * (len(records) + 1), pieces, self.layers, None, QUANTUM_MM, None,
                                  self.run)  # fmt: skip
            if done == len(records):
                hand_on()
        except BaseException:
            self.waiting = []
            raise
        self.waiting = waiting[done:]

    def _is_crossing(self):
        """Say whether a motor is on its way through its slack where the present record begins."""
        run, near = self.run, self.layout.NEAR_MM
        for k in range(2):
            turn = run.turns[k][run.turn[k]]
            if turn.begin < run.begin - near and turn.end > run.begin + near:
                return True
        return False

    def _moves(self, wanted, at, pieces):
        """Return a move's moves from where it begins ``at``: [x y z e …], speed, and acceleration where it changes."""
        begin, end, moves, done = wanted.begin, wanted.end, [], 0.0
        for piece in pieces:
            speed = piece.feed / 60.0 if piece.feed > 0.0 else wanted.speed
            to, count = (piece.x, piece.y, piece.z), 1
            if piece.kind == self.text.PIECE_ARC:  # cut as Klipper would cut it out of a mended file
                _, _, clockwise, chord_mm = wanted.arc
                self.curves.set_arc(self.piece, *at, *to, piece.c0, piece.c1, 0, clockwise, 0)
                count = max(1, math.floor(self.piece.length / chord_mm))
            for part in range(1, count + 1):
                share = min(done + piece.share * part / count, 1.0)
                rest = end[3:] if share > 1.0 - 1e-9 else [a + (b - a) * share for a, b in zip(begin[3:], end[3:])]
                place = to if part == count else self.curves.place(self.piece, part / count)
                moves.append(([*place, *rest], speed, piece.accel))
            at, done = to, min(done + piece.share, 1.0)
        if done < 1.0 - 1e-9:
            moves.append(([*self.commanded(end[2]), *end[3:]], wanted.speed, 0.0))
        return moves
