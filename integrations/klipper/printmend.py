# SPDX-License-Identifier: GPL-3.0-or-later
"""Klipper extra: corrects every move while it is made, from the model that `printmend learn` wrote.

[printmend]
model: ~/printer_data/config/printer.mend.json
#segment: 1.0         longest piece of a corrected move [mm]
#if_foreign: hold     (or print) a file that was mended with another model
#if_forged: hold      (or print) a file that was changed after it was mended
#phase_x: 17          the motor's phase at zero when the test print was made: PRINTMEND_PHASE SAVE=1 notes it
#phase_y: 3

What is wanted goes through the inverse of the frame and of each motor's drive: u ← min(max(u, lower(m)), upper(m)) is
the belt under a motor at m, so m = lower⁻¹(u) going forwards and upper⁻¹(u) going back. Where a motor turns, a move
that extrudes nothing takes up the slack first. Pure Python: no numpy, and of printmend only the file that knows seals.
"""

import bisect
import importlib.util
import json
import math
import os

PLACE = os.path.join(os.path.dirname(os.path.realpath(__file__)), "../../src/printmend/provenance.py")
NEWEST = 2
PITCH_MM = 0.05  # of the tables, and at least 24 places a wave
EXPONENTS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
STILL_MM = 1e-7
LEFT_MM = 0.02  # what corrected pieces may leave
DRIVERS = ("tmc2130", "tmc2208", "tmc2209", "tmc2240", "tmc2660", "tmc5160")  # those that tell their phase
STEPS_A_TURN = 4  # full steps of an electrical turn


def load_provenance():
    """Return printmend's module of marks and seals, from the folder that this file was linked from."""
    if not os.path.isfile(PLACE):
        raise ImportError(f"there is no {PLACE}: link printmend.py out of printmend's folder, do not copy it")
    spec = importlib.util.spec_from_file_location("printmend_provenance", PLACE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


provenance = load_provenance()


class ModelRefused(Exception):
    """The model is none, or holds what a live transform cannot do; the text says which."""


def read_model(path):
    """Read printer.mend.json; refuse what was changed, is newer, or needs more than x and y."""
    try:
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
    except (OSError, ValueError) as error:
        raise ModelRefused(f"{path} cannot be read: {error}") from None
    if not isinstance(document, dict) or document.get("format") != "printmend model":
        raise ModelRefused(f"{path} is not a printer.mend.json")
    if document.get("version", 0) > NEWEST:
        raise ModelRefused(f"{path} was written by a newer printmend: update this extra")
    digest = document.pop("digest", None)
    document["key"] = provenance.seal_key(document)
    if digest != document["key"][:16]:
        raise ModelRefused(f"{path} was changed or damaged: copy it again")
    if document.get("screw") is not None:
        raise ModelRefused("the model has a bad Z screw, which a live transform cannot correct: use `printmend mend`")
    for section in document["motors"].values():
        if section["kind"] not in ("healthy", "series", "table"):
            raise ModelRefused(
                "the model has a drive of kind {}, unknown here: update this extra".format(section["kind"])
            )
    return document


class Drive:
    """One motor: its two tables over the motor's position, and where motor and belt are."""

    def __init__(self, section, low_mm, high_mm, homes_forwards):
        self.homes_forwards = homes_forwards
        span = high_mm - low_mm
        self.curved = section["kind"] != "healthy"
        if section["kind"] == "table":
            grid, lower, upper = self._table(section)
        else:
            grid, lower, upper = self._series(section, low_mm - span, high_mm + span)
        middle = len(grid) // 2
        self.grid, self.lower, self.upper = grid, rising(lower, middle), rising(upper, middle)
        self.m = self.u = 0.0

    @staticmethod
    def _table(section):
        lower = section["lower_error_mm"]
        upper = section.get("upper_error_mm", lower)
        grid = [section["first_mm"] + section["pitch_mm"] * i for i in range(len(lower))]
        return grid, [m + e for m, e in zip(grid, lower)], [m + e for m, e in zip(grid, upper)]

    @staticmethod
    def _series(section, low_mm, high_mm):
        if section["kind"] == "healthy":
            return [low_mm, high_mm], [low_mm, high_mm], [low_mm, high_mm]
        turn, middle, reach = section["period_mm"], section["middle_mm"], section["reach_mm"]
        waves = {name: section.get(name) for name in ("mean", "play", "elastic")}
        highest = max([1] + [k for wave in waves.values() if wave for k in wave["harmonics"]])
        count = math.ceil(turn / min(PITCH_MM, turn / highest / 24))
        pitch, first = turn / count, math.floor(low_mm / turn) * count
        grid = [(first + i) * pitch for i in range(int((high_mm - low_mm) / pitch) + 2 * count)]
        rounds = {name: fourier(wave, count) for name, wave in waves.items()}
        warp = section.get("warp")
        lower, upper = [], []
        for i, m in enumerate(grid):
            x = (m - middle) / 100.0
            seen = min(max(m, reach[0]), reach[1])
            mean = powers(waves["mean"], x, reach, middle) + rounds["mean"][i % count]
            if warp:
                place = min(max((seen - warp["first_mm"]) / (warp["last_mm"] - warp["first_mm"]), 0.0), 1.0)
                mean += sum(c * math.cos(math.pi * k * place) for k, c in enumerate(warp["cos_mm"], 1))
                at = round(seen / pitch) % count
                mean += (seen - middle) / 100.0 * rounds["elastic"][at]
            else:
                mean += x * rounds["elastic"][i % count]
            play = max(powers(waves["play"], x, reach, middle) + rounds["play"][i % count], 0.0)
            lower.append(m + mean - play / 2)
            upper.append(m + mean + play / 2)
        return grid, lower, upper

    def at(self, table, m):
        """Return the belt's place on a branch."""
        grid = self.grid
        if m <= grid[0]:
            return table[0] + m - grid[0]
        if m >= grid[-1]:
            return table[-1] + m - grid[-1]
        i = min(int((m - grid[0]) / (grid[-1] - grid[0]) * (len(grid) - 1)), len(grid) - 2)
        return table[i] + (table[i + 1] - table[i]) * (m - grid[i]) / (grid[i + 1] - grid[i])

    def inverse(self, table, u):
        """Return the motor's place that puts a branch at u."""
        grid = self.grid
        if u <= table[0]:
            return grid[0] + u - table[0]
        if u >= table[-1]:
            return grid[-1] + u - table[-1]
        i = bisect.bisect_right(table, u) - 1
        rise = table[i + 1] - table[i]
        return grid[i] + (grid[i + 1] - grid[i]) * ((u - table[i]) / rise if rise > 0.0 else 0.0)

    def left_mm(self, low_mm, high_mm, segment_mm):
        """Return what straight pieces of a length leave of the tables' waves."""
        half, most = segment_mm / 2, 0.0
        for i in range(int((high_mm - low_mm) / segment_mm * 3.3)):
            m = low_mm + i * segment_mm / 3.3
            for table in (self.lower, self.upper):
                chord = (self.at(table, m - half) + self.at(table, m + half)) / 2
                most = max(most, abs(self.at(table, m) - chord))
        return most

    def home(self, m):
        """The end stop was just met here: the branch of the homing direction is engaged."""
        self.m, self.u = m, self.at(self.lower if self.homes_forwards else self.upper, m)

    def drag(self, m):
        """Somebody else moved the motor: the belt follows."""
        self.u = max(self.u, self.at(self.lower, m)) if m > self.m else min(self.u, self.at(self.upper, m))
        self.m = m

    def aim(self, u):
        """Return the motor's place for the belt at u; a belt that stays needs no move."""
        if abs(u - self.u) < STILL_MM:
            return self.m
        return self.inverse(self.lower if u > self.u else self.upper, u)

    def engage(self, u):
        """Return where the motor touches the belt that is to move to u, with the belt still at rest."""
        if abs(u - self.u) < STILL_MM:
            return self.m
        if u > self.u:
            return max(self.m, self.inverse(self.lower, self.u))
        return min(self.m, self.inverse(self.upper, self.u))


def rising(table, first):
    """Make a table non-decreasing from the middle outwards."""
    for i in range(first + 1, len(table)):
        table[i] = max(table[i], table[i - 1])
    for i in range(first - 1, -1, -1):
        table[i] = min(table[i], table[i + 1])
    return table


def fourier(wave, count):
    """Return one turn of a wave's harmonics."""
    turn = [0.0] * count
    if not wave:
        return turn
    for k, a, b in zip(wave["harmonics"], wave["cos_mm"], wave["sin_mm"]):
        for i in range(count):
            phase = 2 * math.pi * k * i / count
            turn[i] += a * math.cos(phase) + b * math.sin(phase)
    return turn


def powers(wave, x, reach, middle):
    """Return a wave's polynomial; of the second degree and more it goes on as a straight line beyond what was seen."""
    if not wave or not wave["powers_mm"]:
        return 0.0
    c = wave["powers_mm"]
    inside = x if len(c) < 3 else min(max(x, (reach[0] - middle) / 100.0), (reach[1] - middle) / 100.0)
    value = sum(a * inside**k for k, a in enumerate(c))
    return value + (x - inside) * sum(k * a * inside ** (k - 1) for k, a in enumerate(c) if k)


class Machine:
    """The whole printer: a place on the bed to its motors and back."""

    def __init__(self, document):
        printer = document["printer"]
        x, y = printer["x"], printer["y"]
        self.kinematics = printer["kinematics"]
        self.corexy = self.kinematics == "corexy"
        self.frame = document.get("frame")
        corners = [self.motors((a, b)) for a in (x["min_mm"], x["max_mm"]) for b in (y["min_mm"], y["max_mm"])]
        up = [axis["home_side"] == "max" for axis in (x, y)]
        if self.corexy:  # the axis that homes last, y, moves both motors
            up = [up[1], not up[1]]
        self.drives, self.ranges = [], []
        for k, name in enumerate(("a", "b") if self.corexy else ("x", "y")):
            ends = [corner[k] for corner in corners]
            self.ranges.append((min(ends), max(ends)))
            self.drives.append(Drive(document["motors"][name], *self.ranges[k], up[k]))
        self.curved = self.frame is not None or any(drive.curved for drive in self.drives)

    def left_mm(self, segment_mm):
        return max(drive.left_mm(*ends, segment_mm) for drive, ends in zip(self.drives, self.ranges))

    def motors(self, xy):
        return (xy[0] + xy[1], xy[0] - xy[1]) if self.corexy else (xy[0], xy[1])

    def places(self, motors):
        a, b = motors
        return ((a + b) / 2.0, (a - b) / 2.0) if self.corexy else (a, b)

    def framed(self, xy):
        """Return where belts at xy put the nozzle: the identity and the frame's polynomial, its constant included."""
        if self.frame is None:
            return xy
        s = self.frame["scale_mm"]
        x, y = xy[0] / s, xy[1] / s
        terms = [x**p * y**q for p, q in EXPONENTS]
        return tuple(at + sum(c * t for c, t in zip(self.frame[row], terms))
                     for at, row in zip(xy, ("x_mm", "y_mm")))  # fmt: skip

    def unframed(self, xy):
        if self.frame is None:
            return xy
        belt = xy
        for _ in range(60):
            got = self.framed(belt)
            off = (xy[0] - got[0], xy[1] - got[1])
            belt = (belt[0] + off[0], belt[1] + off[1])
            if abs(off[0]) + abs(off[1]) < 1e-7:
                break
        return belt

    def wanted(self):
        """Return where the nozzle is."""
        return self.framed(self.places([drive.u for drive in self.drives]))


class Printmend:
    """The link in Klipper's chain of move transforms."""

    def __init__(self, config):
        self.printer = config.get_printer()
        self.segment_mm = config.getfloat("segment", 1.0, above=0.0)
        path = os.path.expanduser(config.get("model"))
        try:
            document = read_model(path)
        except ModelRefused as refused:
            raise config.error(f"[printmend] {refused}") from None
        self._compare(config, document["printer"])
        self.key = document["key"]
        choices = {"hold": "hold", "print": "print"}
        self.chosen = {state: config.getchoice("if_" + state, choices, "hold") for state in ("foreign", "forged")}
        self.machine = Machine(document)
        left_mm = self.machine.left_mm(self.segment_mm)
        if left_mm > LEFT_MM:
            raise config.error(
                f"[printmend] the model has waves that are too short for pieces of {self.segment_mm:g} mm: up to "
                f"{left_mm:.3f} mm would remain; make segment smaller, or use `printmend mend`"
            )
        self.name = "{}, model {}".format(document["printer"].get("name"), os.path.basename(path))
        self.active, self.known, self.next = True, False, None
        self.phases = [config.getint("phase_" + name, None, minval=0) for name in "xy"]
        self.microsteps = [config.getsection("stepper_" + name).getint("microsteps", note_valid=False) for name in "xy"]
        self.shift = [0.0, 0.0]
        events = {"klippy:connect": self._connect, "homing:home_rails_end": self._homed,
                  "virtual_sdcard:load_file": self._loaded, "virtual_sdcard:reset_file": self._unloaded}  # fmt: skip
        for event, handler in events.items():
            self.printer.register_event_handler(event, handler)
        gcode = self.printer.lookup_object("gcode")
        gcode.register_command(
            "PRINTMEND", self.cmd_PRINTMEND, desc="Say whether moves are corrected; ENABLE=0|1 switches"
        )
        gcode.register_command(
            "PRINTMEND_PHASE", self.cmd_PRINTMEND_PHASE, desc="Say the motors' phases at zero; SAVE=1 notes them"
        )

    def _compare(self, config, printer):
        """Refuse the model of another machine: the tables count from the end stops, in turns of the motors."""
        kinematics = config.getsection("printer").get("kinematics")
        if kinematics != printer["kinematics"]:
            raise config.error("[printmend] the model is for {}, not {}".format(printer["kinematics"], kinematics))
        for name in ("x", "y"):
            stepper, axis = config.getsection("stepper_" + name), printer[name]
            turn = stepper.getfloat("rotation_distance", note_valid=False)
            gears = stepper.get("gear_ratio", None, note_valid=False)
            if gears is None and abs(turn - axis["mm_per_turn"]) > 1e-3 * axis["mm_per_turn"]:
                raise config.error("[printmend] stepper_{}: the model was learned with rotation_distance {:g}, not "
                                   "{:g}: learn again".format(name, axis["mm_per_turn"], turn))  # fmt: skip
            home = stepper.getfloat("position_endstop", axis["home_mm"], note_valid=False)
            if abs(home - axis["home_mm"]) > 0.5:
                raise config.error("[printmend] stepper_{}: the model's end stop is at {:g} mm, not at {:g} mm: learn "
                                   "with this printer's geometry".format(name, axis["home_mm"], home))  # fmt: skip

    def _connect(self):
        self.gcode_move = self.printer.lookup_object("gcode_move")
        self.next = self.gcode_move.set_move_transform(self, force=True)

    def _homed(self, state, rails):
        self.known = False

    def _zero_phase(self, k):
        """Return the micro-step of its electrical turn at which motor k is where Klipper counts zero, the micro-steps
        of that turn and their length; None for the first where no driver tells it."""
        name = "stepper_" + "xy"[k]
        steppers = self.printer.lookup_object("toolhead").get_kinematics().get_steppers()
        stepper = next(each for each in steppers if each.get_name() == name)
        turn, offset = STEPS_A_TURN * self.microsteps[k], None
        for kind in DRIVERS:
            driver = self.printer.lookup_object(f"{kind} {name}", None)
            if driver is not None:
                offset, turn = driver.get_phase_offset()
        step = stepper.get_step_dist()
        if offset is None:
            if self.printer.get_start_args().get("debugoutput") is None:
                return None, turn, step
            offset = 0  # nothing is driven: the count of steps is the phase
        zero = stepper.get_mcu_position() - round(stepper.get_commanded_position() / step)
        return (zero + offset) % turn, turn, step

    def _shifts(self):
        """Return by how much each motor is further on than where the test print had it at this count.

        It is less than half an electrical turn. The end stops switch elsewhere each time; a place of the rail always
        has the same phase.
        """
        shifts = []
        for k, kept in enumerate(self.phases):
            zero, turn, step = (None, 0, 0.0) if kept is None else self._zero_phase(k)
            off = 0 if zero is None else (zero - kept + turn // 2) % turn - turn // 2
            shifts.append(off * step)
        return shifts

    def _commanded(self, motors):
        """Return the chain's place for motors as the model counts them."""
        return list(self.machine.places([m - by for m, by in zip(motors, self.shift)]))

    def _sync(self):
        """Return the chain's position; where somebody else moved the motors, find the belts again."""
        position = self.next.get_position()
        self.shift = self._shifts()
        motors = [m + by for m, by in zip(self.machine.motors(position), self.shift)]
        for drive, m in zip(self.machine.drives, motors):
            if not self.known:
                drive.home(m)
            elif abs(m - drive.m) > STILL_MM:
                drive.drag(m)
        self.known = True
        return position

    def get_position(self):
        position = self._sync()
        return list(self.machine.wanted()) + position[2:] if self.active else position

    def move(self, to, speed):
        """Make a wanted move [x y z e] out of corrected pieces."""
        if not self.active:
            self.next.move(to, speed)
            return
        start = self.get_position()
        way = math.hypot(to[0] - start[0], to[1] - start[1])
        if way < STILL_MM:
            self.next.move(self._commanded([drive.m for drive in self.machine.drives]) + to[2:], speed)
            return
        count = math.ceil(way / self.segment_mm - 1e-9) if self.machine.curved else 1
        for i in range(1, count + 1):
            share = i / count
            self._piece([a + (b - a) * share for a, b in zip(start, to)], way / count, speed)

    def _piece(self, to, way_mm, speed):
        """Make one short piece: take up slack, then go, at the speed at which the nozzle is to go."""
        machine = self.machine
        goals = machine.motors(machine.unframed((to[0], to[1])))
        engaged = [drive.engage(u) for drive, u in zip(machine.drives, goals)]
        before = [drive.m for drive in machine.drives]
        if any(abs(a - b) > 1e-4 for a, b in zip(engaged, before)):
            here = self.next.get_position()
            self.next.move(self._commanded(engaged) + here[2:], max(speed, 50.0))
            before = engaged
        motors = [drive.aim(u) for drive, u in zip(machine.drives, goals)]
        for drive, m, u in zip(machine.drives, motors, goals):
            drive.m, drive.u = m, u
        place, last = self._commanded(motors), self._commanded(before)
        length = math.hypot(place[0] - last[0], place[1] - last[1])
        self.next.move(place + to[2:], speed * (length / way_mm) if length > STILL_MM else speed)

    def _switch(self, active):
        if active != self.active:
            self._sync()
            self.active = active
            self.gcode_move.reset_last_position()

    def _loaded(self):
        """Leave a mended file alone, and a test print, which must show the printer as it is.

        Raises where the file is another model's: whoever loaded it to print it gets the error, and nothing is printed.
        """
        path = self.printer.lookup_object("virtual_sdcard").file_path()
        start = provenance.head_of(path or "")
        mark = provenance.MARK.search(start)
        if mark is not None:
            self._refuse(mark[2].decode("ascii", "replace"), path)
        what = "mended" if mark else "a test print" if provenance.TEST_PRINT_MARK.search(start) else ""
        if what and self.active:
            self._switch(False)
            self.printer.lookup_object("gcode").respond_info(f"printmend: the file is {what}; moves stay as they are")

    def _refuse(self, digest, path):
        """Raise where a mended file is another model's, or is not what printmend wrote."""
        reactor = self.printer.get_reactor()
        if digest != self.key[:16]:
            state, words = "foreign", f"was mended with model {digest}, and {self.key[:16]} is in use"
        elif not provenance.is_sealed(path, self.key, breathe=lambda: reactor.pause(reactor.monotonic())):
            state, words = "forged", "was changed after it was mended"
        else:
            return
        if provenance.action(state, self.chosen) == "hold":
            raise self.printer.command_error(
                f"printmend: {os.path.basename(path)} {words}; mend its original again, or choose if_{state}: print"
            )

    def _unloaded(self):
        self._switch(True)

    def cmd_PRINTMEND(self, gcmd):
        self._switch(bool(gcmd.get_int("ENABLE", int(self.active), minval=0, maxval=1)))
        gcmd.respond_info(
            "printmend: moves are {} ({})".format("corrected" if self.active else "left alone", self.name)
        )

    def cmd_PRINTMEND_PHASE(self, gcmd):
        said = []
        for k, name in enumerate("xy"):
            zero, turn, _ = self._zero_phase(k)
            if zero is None:
                raise gcmd.error(f"printmend: no driver tells the phase of stepper_{name}: it takes a Trinamic one")
            said.append(f"{name} {zero}/{turn}")
            if gcmd.get_int("SAVE", 0):
                self.phases[k] = zero
                self.printer.lookup_object("configfile").set("printmend", "phase_" + name, zero)
        kept = "; kept, SAVE_CONFIG writes them" if gcmd.get_int("SAVE", 0) else ""
        gcmd.respond_info("printmend: phases at zero are {}{}".format(", ".join(said), kept))

    def get_status(self, eventtime=None):
        return {"active": self.active, "model": self.name}


def load_config(config):
    return Printmend(config)
