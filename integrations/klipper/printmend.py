# SPDX-License-Identifier: GPL-3.0-or-later
"""Klipper extra: corrects every move while it is made, from the model that `printmend learn` wrote.

[printmend]
model: ~/printer_data/config/printer.mend.json
#if_stale: hold       (or print) a file that was mended with an earlier model of this printer
#if_foreign: hold     (or print) one that was mended with another printer's model
#if_forged: hold      (or print) a file that was changed after it was mended
#phase_x: 17          the motor's phase at zero when the test print was made: PRINTMEND_PHASE SAVE=1 notes it
#phase_y: 3
#tolerance: 0.01      how near the path is kept [mm]; 0.003 for fine patterns on walls

Moves wait here until the path that they belong to is whole. Then they are planned as `printmend mend` plans a file, by
the same kernels (live/), and handed on. Whoever asks the tool head for its time or its place has them handed on first.
Pure Python: no numpy, and of printmend only its kernels and the file that knows seals.
"""

import contextlib
import importlib.util
import json
import os
import sys

HERE = os.path.dirname(os.path.realpath(__file__))
PLACE = os.path.join(HERE, "../../src/printmend/provenance.py")
NEWEST = 2
KINDS = ("stale", "foreign", "forged")  # of files that are held where their owner does not choose otherwise
WAIT_S = 0.1  # without a further move, those that wait are planned
DRIVERS = ("tmc2130", "tmc2208", "tmc2209", "tmc2240", "tmc2660", "tmc5160")  # those that tell their phase
STEPS_A_TURN = 4  # full steps of an electrical turn
LIMITS = ("max_velocity", "max_accel", "square_corner_velocity", "min_cruise_ratio", "junction_deviation",
          "max_accel_to_decel")  # fmt: skip
# What of the tool head others call that needs to know of all moves before it:
ASKED = ("get_last_move_time", "wait_moves", "flush_step_generation", "dwell", "drip_move", "manual_move", "move",
         "set_position", "get_position", "set_extruder")  # fmt: skip


def load_beside(name, path):
    """Return a module of printmend, from the folder that this file was linked from."""
    if not os.path.isfile(path):
        raise ImportError(f"there is no {path}: link printmend.py out of printmend's folder, do not copy it")
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


provenance = load_beside("printmend_provenance", PLACE)
planner = load_beside("printmend_live_planner", os.path.join(HERE, "live/planner.py"))


class ModelRefused(Exception):
    """The model is none, or is of another printer; the text says which."""


def read_model(path):
    """Read printer.mend.json; refuse what was changed or is newer."""
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
    if digest != provenance.seal_key(document)[:16]:
        raise ModelRefused(f"{path} was changed or damaged: copy it again")
    for section in document["motors"].values():
        if section["kind"] not in ("healthy", "series", "table"):
            raise ModelRefused(
                "the model has a drive of kind {}, unknown here: update this extra".format(section["kind"])
            )
    return document


class Printer:
    """What of Klipper's configuration a model must fit: its tables count from the end stops, in turns of the motors."""

    def __init__(self, config):
        self.kinematics = config.getsection("printer").get("kinematics")
        self.turns, self.homes = {}, {}
        for name in "xyz":
            if not config.has_section("stepper_" + name):
                continue
            stepper = config.getsection("stepper_" + name)
            if stepper.get("gear_ratio", None, note_valid=False) is None:
                self.turns[name] = stepper.getfloat("rotation_distance", note_valid=False)
            if name != "z":
                self.homes[name] = stepper.getfloat("position_endstop", None, note_valid=False)

    def check(self, document):
        """Refuse the model of another machine."""
        printer = document["printer"]
        if self.kinematics != printer["kinematics"]:
            raise ModelRefused("the model is for {}, not {}".format(printer["kinematics"], self.kinematics))
        for name in "xyz" if document.get("screw") is not None else "xy":
            axis, turn, home = printer[name], self.turns.get(name), self.homes.get(name)
            if turn is not None and abs(turn - axis["mm_per_turn"]) > 1e-3 * axis["mm_per_turn"]:
                raise ModelRefused("stepper_{}: the model was learned with rotation_distance {:g}, not {:g}: learn "
                                   "again".format(name, axis["mm_per_turn"], turn))  # fmt: skip
            if home is not None and abs(home - axis["home_mm"]) > 0.5:
                raise ModelRefused("stepper_{}: the model's end stop is at {:g} mm, not at {:g} mm: learn with this "
                                   "printer's geometry".format(name, axis["home_mm"], home))  # fmt: skip


def parts_of(document):
    """Return in words what a model corrects, one part of the printer each."""
    said = []
    for name, section in document["motors"].items():
        if section["kind"] != "healthy":
            said.append(f"motor {name.upper()}")
    frame = document.get("frame")
    if frame is not None:
        said.append("frame and rails" if frame.get("waves") else "frame")
    return said + (["Z screw"] if document.get("screw") is not None else [])


class Printmend:
    """The link in Klipper's chain of move transforms."""

    def __init__(self, config):
        self.printer = config.get_printer()
        config.getfloat("segment", None)  # of earlier versions: pieces are now as long as the model lets them be
        self.fits, self.folder = Printer(config), os.path.dirname(os.path.expanduser(config.get("model")))
        usual = planner.tables.TOLERANCE_MM
        self.tolerance = config.getfloat("tolerance", usual, minval=0.002, maxval=0.2)  # as `mend --tolerance`
        choices = {"hold": "hold", "print": "print"}
        self.chosen = {state: config.getchoice("if_" + state, choices, "hold") for state in KINDS}
        self.ledger, self.file = provenance.Ledger(os.path.join(self.folder, ".printmend")), ""
        try:
            self._load(os.path.basename(config.get("model")))
        except ModelRefused as refused:
            raise config.error(f"[printmend] {refused}") from None
        self.active, self.homed, self.next = True, 7, None
        self.phases = [config.getint("phase_" + name, None, minval=0) for name in "xy"]
        self.microsteps = [config.getsection("stepper_" + name).getint("microsteps", note_valid=False) for name in "xy"]
        self.shift, self.at, self.limits = [0.0, 0.0], None, None
        self.handing_on, self.failed, self.timer, self.chords = False, None, None, None
        events = {"klippy:connect": self._connect, "homing:home_rails_end": self._homed,
                  "virtual_sdcard:load_file": self._loaded, "virtual_sdcard:reset_file": self._unloaded}  # fmt: skip
        for event, handler in events.items():
            self.printer.register_event_handler(event, handler)
        gcode = self.printer.lookup_object("gcode")
        for command, said in (("PRINTMEND", "Switch the correction: ENABLE=0|1, MODEL=name"),
                              ("PRINTMEND_STATUS", "Say what is corrected, and with which model"),
                              ("PRINTMEND_PHASE", "Say the motors' phases at zero; SAVE=1 notes them")):  # fmt: skip
            gcode.register_command(command, getattr(self, "cmd_" + command), desc=said)

    def _load(self, name):
        """Take the model of a name, with or without its ending, in the folder of the one that was configured."""
        if os.path.basename(name) != name:
            raise ModelRefused(f"{name} is no name of a model in {self.folder}")
        path = os.path.join(self.folder, name)
        if not os.path.isfile(path) and os.path.isfile(path + ".mend.json"):
            path += ".mend.json"
        document = read_model(path)
        self.fits.check(document)
        self.planner, self.parts, self.path = planner.Planner(document, self.tolerance), parts_of(document), path
        self.model = provenance.read_model(path)
        with contextlib.suppress(OSError):  # a folder that cannot be written: files of this model are foreign one day
            self.ledger.remember(self.model)
        self.name = "{}, model {}".format(document["printer"].get("name"), os.path.basename(path))

    def _connect(self):
        self.gcode_move = self.printer.lookup_object("gcode_move")
        self.next = self.gcode_move.set_move_transform(self, force=True)
        self.toolhead = self.printer.lookup_object("toolhead")
        for name in ASKED:
            if hasattr(self.toolhead, name):
                setattr(self.toolhead, name, self._after_waiting(getattr(self.toolhead, name)))
        arcs = self.printer.lookup_object("gcode_arcs", None)
        if hasattr(arcs, "planArc"):
            arcs.planArc = self._whole(arcs.planArc, arcs.mm_per_arc_segment)
        self.planned = sys.modules[type(self.toolhead).__module__].Move
        self.call_later = self.toolhead.register_lookahead_callback
        self.toolhead.register_lookahead_callback = self._call_in_turn
        if self.printer.get_start_args().get("debugoutput") is None:
            self.timer = self.printer.get_reactor().register_timer(self._waited)

    def _after_waiting(self, asked):
        def after(*given, **named):
            self._hand_on()
            return asked(*given, **named)

        return after

    def _whole(self, cut, chord_mm):
        """Return what cuts an arc into chords, each of which is made as a move: together they come here as the arc."""

        def cut_together(start, end, offset, clockwise, gcmd, absolute, *axes):
            if not self.active or axes[:2] != (0, 1):
                return cut(start, end, offset, clockwise, gcmd, absolute, *axes)
            begin, self.chords = self.get_position(), []
            try:
                return cut(start, end, offset, clockwise, gcmd, absolute, *axes)
            finally:
                chords, self.chords = self.chords, None
                if chords:
                    arc = (begin[0] + offset[0], begin[1] + offset[1], clockwise, chord_mm)
                    self._wait(begin, *chords[-1], arc if len(chords) > 1 else None)

        return cut_together

    def _call_in_turn(self, callback):
        """Call somebody back as the last move begins that was wanted before, though it may still wait."""
        waiting = self.planner.waiting
        if waiting and not self.handing_on:
            waiting[-1].note[1].append(callback)
        else:
            self.call_later(callback)

    def _waited(self, eventtime):
        try:
            self._hand_on()
        except self.printer.command_error as error:
            self.failed = error  # whoever moves next gets it
        return self.printer.get_reactor().NEVER

    def _homed(self, state, rails):
        self._hand_on()
        for axis in state.get_axes():
            self.homed |= 1 << axis

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

    def _sync(self):
        """Return the chain's position; where somebody else moved the motors, find the belts again."""
        self._hand_on()
        position = self.next.get_position()
        self.shift = self._shifts()
        if self.homed:
            self.planner.home(self.homed)
            self.homed = 0
        self.planner.drag(*self._shifted(position, 1.0))
        return list(position)

    def _shifted(self, place, way):
        """Return a place of the chain as the model counts it, or with ``way`` −1 the other way round."""
        look, model = self.planner.look, self.planner.model
        motors = look.to_motors(model, place[0], place[1])
        x, y = look.from_motors(model, *(m + way * by for m, by in zip(motors, self.shift)))
        return x, y, place[2]

    def get_position(self):
        """Return where the nozzle is wanted: behind the last move, though it may still wait."""
        if self.planner.waiting or self.handing_on or self.chords:
            return list(self.at)
        position = self._sync()
        return [*self.planner.place(position[2]), *position[3:]] if self.active else position

    def move(self, to, speed):
        """Let a wanted move [x y z e] wait for those that belong to it."""
        failed, self.failed = self.failed, None
        if failed is not None:
            raise failed
        if not self.active:
            self.next.move(to, speed)
            return
        start = self.get_position()
        self._check(start, to, speed)
        self.at = list(to)
        if self.chords is None:
            self._wait(start, list(to), speed)
        else:
            self.chords.append((list(to), speed))

    def _wait(self, start, to, speed, arc=None):
        """Let a move wait that has been checked."""
        limits = self._limits()
        count = self.planner.add(start, to, speed, (limits, []), arc, limits["max_accel"])
        if count:
            self._hand_on(count)
        if self.timer is not None and self.planner.waiting:
            reactor = self.printer.get_reactor()
            reactor.update_timer(self.timer, reactor.monotonic() + WAIT_S)

    def _check(self, start, to, speed):
        """Refuse at once what Klipper would: a move off the bed, of an axis that is not homed, of a cold tool."""
        move = self.planned(self.toolhead, list(start), list(to), speed)
        if move.is_kinematic_move:
            self.toolhead.get_kinematics().check_move(move)
        axes = getattr(self.toolhead, "extra_axes", None)
        if axes is None and move.axes_d[3]:  # Klipper of before 2025
            self.toolhead.get_extruder().check_move(move)
        for index, axis in enumerate(axes or (), 3):
            if move.axes_d[index]:
                axis.check_move(move, index)

    def _hand_on(self, count=None):
        """Plan moves that wait, all of them where no count is given."""
        if self.handing_on or not self.planner.waiting:
            return
        self.handing_on = True
        now = self._limits()
        self.planner.shape(self._pulses())
        try:
            self.planner.plan(len(self.planner.waiting) if count is None else count, self._put)
        finally:
            self.handing_on = False
            self._set(now)

    def _pulses(self):
        """Return the pulses of the input shapers of x and of y: when they come [s], and their weights."""
        shaper = self.printer.lookup_object("input_shaper", None)
        shapers = [] if shaper is None else [each.get_shaper() for each in shaper.get_shapers()[:2]]
        return tuple(tuple(zip(times, weights)) for _, weights, times in shapers) or ((), ())

    def _limits(self):
        return {name: getattr(self.toolhead, name) for name in LIMITS if hasattr(self.toolhead, name)}

    def _set(self, limits):
        for name, value in limits.items():
            setattr(self.toolhead, name, value)

    def _put(self, wanted, moves):
        """Make a wanted move out of commanded ones, under the limits that held when it was wanted."""
        limits, callbacks = wanted.note
        hurried = None
        for to, speed, accel in moves:
            if accel != hurried:
                hurried = accel
                self._set(limits)
                if accel:  # a motor that crosses its slack drives nothing but itself
                    self.toolhead.max_accel = accel
                    self.toolhead._calc_junction_deviation()
            self.next.move([*self._shifted(to, -1.0), *to[3:]], speed)
        for callback in callbacks:
            self.call_later(callback)

    def _switch(self, active):
        if active != self.active:
            self._sync()
            self.active = active
            self.gcode_move.reset_last_position()

    def _loaded(self):
        """Leave a mended file alone, and a test print, which must show the printer as it is.

        Raises where the file is not what this printer's model made: whoever loaded it to print it gets the error, and
        nothing is printed.
        """
        path = self.printer.lookup_object("virtual_sdcard").file_path() or ""
        self.file, words = self._judge(path)
        newer = self._newer()
        if self.file in self.chosen and provenance.action(self.file, self.chosen) == "hold":
            raise self.printer.command_error(
                "printmend: {} {}, or choose if_{}: print{}".format(
                    os.path.basename(path), words, self.file, newer and "; " + newer
                )
            )
        told = [newer] if newer else []
        if self.file != provenance.UNMENDED and self.active:
            self._switch(False)
            what = "a test print" if self.file == provenance.TEST_PRINT else "mended"
            told.append(f"the file is {what}; moves stay as they are")
        for line in told:
            self.printer.lookup_object("gcode").respond_info("printmend: " + line)

    def _breathe(self):
        reactor = self.printer.get_reactor()
        reactor.pause(reactor.monotonic())

    def _judge(self, path):
        """Return the state of a file, and where it is not as it should be what is wrong and what to do."""
        start = provenance.head_of(path)
        mark = provenance.MARK.search(start)
        if mark is None:
            claim = provenance.claimed_test_print(path, start, breathe=self._breathe)
            return claim or provenance.UNMENDED, (
                "says that it is a test print, but printmend did not write it so; write it again"
            )
        digest, again = mark[2].decode("ascii", "replace"), "mend its original again"
        model = dict(self.ledger.known(), **{self.model.digest: self.model}).get(digest)
        if model is None or model.printer != self.model.printer:
            return provenance.FOREIGN, f"was mended with model {digest}, and {self.model.digest} is in use; {again}"
        if not provenance.is_sealed(path, model.key, breathe=self._breathe):
            return provenance.FORGED, f"was changed after it was mended; {again}"
        if model.digest != self.model.digest:
            return provenance.STALE, (
                f"was mended with model {digest}, another one of this printer; {self.model.digest} is in use; {again}"
            )
        return provenance.CURRENT, ""

    def _newer(self):
        """Return in words that the model's file is another one by now; nothing where it is not."""
        try:
            there = provenance.read_model(self.path).digest
        except provenance.NoModelError as error:
            return f"{error}; the model that was there is in use"
        if there == self.model.digest:
            return ""
        return f"{os.path.basename(self.path)} is model {there} by now; RESTART takes it"

    def _unloaded(self):
        self.file = ""
        self._switch(True)

    def cmd_PRINTMEND(self, gcmd):
        name = gcmd.get("MODEL", None)
        if name is not None:
            self._hand_on()
            try:
                self._load(name)
            except ModelRefused as refused:
                raise gcmd.error(f"printmend: {refused}") from None
            self.homed = 7
            self._sync()
            self.gcode_move.reset_last_position()
        self._switch(bool(gcmd.get_int("ENABLE", int(self.active), minval=0, maxval=1)))
        gcmd.respond_info(
            "printmend: moves are {} ({})".format("corrected" if self.active else "left alone", self.name)
        )

    def cmd_PRINTMEND_STATUS(self, gcmd):
        counts, phases, newer = self.planner.counts, [zero is not None for zero in self.phases], self._newer()
        gcmd.respond_info("\n".join([
            "printmend: moves are {}".format("corrected" if self.active else "left alone"),
            f"model: {self.name}, digest {self.model.digest}",
            *([newer] if newer else []),
            "file: {}".format(self.file or "none"),
            "corrects: {}".format(", ".join(self.parts) or "nothing, the printer is healthy"),
            "locked to the motors' phase: {}".format("yes" if all(phases) else "no" if not any(phases) else "in part"),
            f"slack taken up {counts.takeups} times, {counts.stops} of them with the nozzle standing on its line",
        ]))  # fmt: skip

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
        counts = self.planner.counts
        return {"active": self.active, "model": self.name, "digest": self.model.digest, "file": self.file,
                "corrects": self.parts, "takeups": counts.takeups, "stops": counts.stops,
                "waiting": len(self.planner.waiting)}  # fmt: skip


def load_config(config):
    return Printmend(config)
