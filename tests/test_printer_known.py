"""Which printer a name means, and when a file that names one is not for the printer of a model."""

from dataclasses import replace
from itertools import product

import pytest

from printmend.errors import ModelError
from printmend.gcode.header import Described
from printmend.printer import preset_names, read_printer
from printmend.printer.known import bare_name, printers_named
from printmend.repair.mend import _refuse_contradiction

FOREIGN = (
    "Bambu Lab P1S", "Bambu Lab X1 Carbon 0.4 nozzle", "X1C", "Bambu Lab A1", "Bambu Lab A1 mini",
    "Original Prusa MK4S", "MK4", "Prusa CORE One", "COREONE", "XL5", "Original Prusa XL - 5T 0.6 nozzle", "ENDER6",
    "Creality K1", "K1 Max",
    "Creality Ender-3 V3", "ENDER3S1PLUS", "Ender-3 Max Neo", "Creality Ender-5 Max", "CR10MAX", "Creality CR-10 SE",
    "Voron Trident 300", "Voron_v0_120", "Anycubic Kobra 2 Pro", "Kobra", "Elegoo Neptune 4 Pro", "Sovol SV08",
    "SV06 Plus", "Kingroon KP3S Pro", "LulzBot Mini", "Artillery Sidewinder X4 Pro", "QIDI X-Max 3", "RatRig V-Core 3",
    "FLSun V400", "Snapmaker A350", "Geeetech A20M", "UltiMaker 2", "Bambu Lab H9",
)  # fmt: skip
SILENT = (
    "", "Bob's", "my printer", "Workshop 2", "Dominic's printer plus", "&", "Unknown", "Custom FFF printer", "Prusa i3",
    "0.4 nozzle", "Blender", "mini me", "the hornet", "left one", "Entergetics", "P1", "PLA K1 A1", "300mm", "Marlin",
)  # fmt: skip
OWN = {
    "ender3": ("ENDER3", "Creality Ender-3 Pro", "ENDER3V2NEO", "my own ender3", "Ender 3 S1 Pro", "ENDER3BLTOUCH",
               "Creality Ender-3 V3 SE 0.4 nozzle", "left Ender", "Creality Foo", "Ender-3 (was my CR-10)"),
    "ender3-s1": ("ENDER3", "ENDER3S1", "ENDER3S1PRO"),
    "ender3-v2": ("ENDER3V2", "ENDER3"),
    "ender5": ("ENDER5", "Creality Ender-5 Pro", "Ender-5 S1"),
    "ender5-plus": ("ENDER5PLUS", "Creality Ender-5 Plus 0.4 nozzle"),
    "cr10s": ("CR10S", "Creality CR-10 V2", "CR10SPROV2"), "cr6-se": ("CR6SE", "Creality CR-6"),
    "prusa-mk3s": ("MK3S", "MK3SMMU2S", "Original Prusa i3 MK3S & MK3S+", "Prusa i3 Mk3/Mk3s", "MK3.5S"),
    "prusa-mini": ("MINI", "MINIIS", "Original Prusa MINI & MINI+"),
    "voron2-250": ("Voron V2.4 250mm", "Voron_v2_250_afterburner", "VORON2 250", "Voron 2.4 R2"),
    "sidewinder-x2": ("X1", "Artillery Sidewinder X1", "Sidewinder X2"), "sv06": ("SV06", "Sovol SV06 0.4 nozzle"),
    "taz6": ("TAZ6", "LulzBot TAZ 6"), "i3-mega": ("I3MEGA", "I3MEGAS", "Anycubic i3 Mega S"), "vyper": ("Vyper",),
    "kp3s": ("KP3S",), "neptune2": ("NEPTUNE2S", "Elegoo Neptune 2D"), "aquila": ("AQUILA", "Voxelab Aquila X2"),
    "sapphire-plus": ("Two Trees Sapphire Plus", "Sapphire Plus", "TwoTrees SapphirePlus"),
}  # fmt: skip


def is_refused(preset: str, *names: str) -> bool:
    printer = read_printer(preset)
    try:
        _refuse_contradiction("part.gcode", Described(names, None), printer)
    except ModelError as error:
        return "--force" in error.todo and error.came in [f"G-code for {name}" for name in names]
    return False


@pytest.mark.parametrize("preset", sorted({*preset_names()} - {"corexy"}))
def test_a_file_that_names_another_printer_is_refused(preset):
    passed = [name for name in FOREIGN if not is_refused(preset, name)]
    assert passed == []


@pytest.mark.parametrize("preset", preset_names())
def test_a_name_that_says_nothing_is_not(preset):
    assert [name for name in SILENT if is_refused(preset, name)] == []


@pytest.mark.parametrize("preset", OWN)
def test_a_printer_is_itself_by_all_its_names(preset):
    assert [name for name in OWN[preset] if is_refused(preset, name)] == []


def test_presets_are_other_printers_but_for_upgrades_of_the_same_bed_and_belts():
    one = {"ender3", "ender3-s1", "ender3-v2"}
    for mine, other in product(preset_names(), repeat=2):
        same = mine == other or {mine, other} <= one or "corexy" in (mine, other)
        assert is_refused(mine, read_printer(other).name) != same, (mine, other)
    assert {read_printer(preset).kinematics for preset in one} == {"cartesian"}
    assert len({(read_printer(preset).x.max_mm, read_printer(preset).x.mm_per_step) for preset in one}) == 1


def test_one_name_of_its_own_is_enough():
    assert not is_refused("ender5", "ENDER3", "Bob's Ender-5")
    assert not is_refused("aquila", "ENDER3V2", "Voxelab Aquila 0.4")
    assert is_refused("ender5", "ENDER3", "Bob's")


def test_a_printer_that_its_owner_named_takes_any_name():
    mine = replace(read_printer("ender5"), name="workhorse")
    for name in FOREIGN:
        _refuse_contradiction("part.gcode", Described((name,), None), mine)
    assert printers_named("/home/voron/ender5/workhorse.toml") == frozenset()
    assert printers_named(r"C:\printers\ender5.toml") == printers_named("Ender-5") != frozenset()


def test_a_name_may_be_ambiguous():
    assert printers_named("X1") == {"artillery sidewinder", "bambu lab x1"}
    assert printers_named("MINI") == {"prusa mini", "lulzbot mini"}
    assert printers_named("Creality") > printers_named("CR-10") | printers_named("K1C")
    assert printers_named("Ender-30") == printers_named("Ender") > printers_named("Ender-3")
    assert printers_named("Original Prusa i3 MK2.5S") == {"prusa mk2"}
    assert bare_name("/a/My-Printer 2.toml") == "myprinter2toml"
