"""Which printer a name means, and when a file that names one is not for the printer of a model."""

from dataclasses import replace
from itertools import product

import pytest

from printmend.errors import ModelError
from printmend.gcode.sliced import Described
from printmend.mend.mend import other_printer_words, refuse_contradiction
from printmend.printer import preset_names, read_printer
from printmend.printer.printer import bare_name, printers_named
from printmend.printer.toml import preset_text

FOREIGN = (
    "Bambu Lab P1S", "Bambu Lab X1 Carbon 0.4 nozzle", "X1C", "Bambu Lab A1", "Bambu Lab A1 mini",
    "Original Prusa MK4S", "MK4", "Prusa CORE One", "COREONE", "XL5", "Original Prusa XL - 5T 0.6 nozzle", "ENDER6",
    "Creality K1", "K1 Max",
    "Creality Ender-3 V3", "ENDER3S1PLUS", "Ender-3 Max Neo", "Creality Ender-5 Max", "CR10MAX", "Creality CR-10 SE",
    "Voron Trident 300", "Voron_v0_120", "Anycubic Kobra 2 Pro", "Kobra", "Elegoo Neptune 4 Pro", "Sovol SV08",
    "SV06 Plus", "Kingroon KP3S Pro", "LulzBot Mini", "Artillery Sidewinder X4 Pro", "QIDI X-Max 3", "RatRig V-Core 3",
    "RatRig V-Core 4 400", "Qidi X-Plus 4",
    "FLSun V400", "Snapmaker A350", "Geeetech A20M", "UltiMaker 2", "Bambu Lab H9",
)  # fmt: skip
# Of these the names of presets, and those of a sibling with the same bed and belts.
SHARED = {
    "a1": ("Bambu Lab A1", "Bambu Lab H9"), "p1s": ("Bambu Lab P1S", "Bambu Lab H9"),
    "x1c": ("Bambu Lab X1 Carbon 0.4 nozzle", "X1C", "Bambu Lab H9"),
    "k1": ("Creality K1",), "k1c": ("Creality K1",), "sv08": ("Sovol SV08",),
    "prusa-mk4s": ("Original Prusa MK4S", "MK4"), "prusa-core-one": ("Prusa CORE One", "COREONE"),
    "trident-300": ("Voron Trident 300",), "voron0": ("Voron_v0_120",), "kobra2": ("Anycubic Kobra 2 Pro",),
    "neptune4": ("Elegoo Neptune 4 Pro",), "v-core3-300": ("RatRig V-Core 3",), "v-core3-400": ("RatRig V-Core 3",),
    "v-core3-500": ("RatRig V-Core 3",),
}  # fmt: skip
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
    # as printer_model and printer_settings_id of PrusaSlicer, OrcaSlicer and Bambu Studio have them
    "a1": ("Bambu Lab A1", "Bambu Lab A1 0.4 nozzle"),
    "p1s": ("Bambu Lab P1S", "Bambu Lab P1S 0.4 nozzle", "Bambu Lab P1P"),
    "x1c": ("Bambu Lab X1 Carbon", "Bambu Lab X1 Carbon 0.4 nozzle", "Bambu Lab X1E"),
    "k1": ("Creality K1", "K1", "Creality K1 (0.4 nozzle)", "Creality K1 SE"), "k1c": ("Creality K1C", "Creality K1"),
    "ender3-v3-ke": ("Creality Ender-3 V3 KE", "Creality Ender-3 V3 KE 0.4 nozzle", "ENDER3V3KE"),
    "prusa-mk4s": ("MK4S", "MK4", "Original Prusa MK4S", "Prusa MK4S HF0.4 nozzle", "MK4ISMMU3"),
    "prusa-core-one": ("COREONE", "Prusa CORE One", "Prusa CORE One HF 0.4 nozzle", "COREONEMMU3"),
    "voron0": ("Voron_v0_120", "Voron 0.1", "Voron 0.2 0.4 nozzle", "V0.2r1"),
    "voron2-300": ("Voron 2.4 300", "Voron_v2_300_afterburner", "Voron 2.4 300 0.4 nozzle", "Voron V2.4"),
    "voron2-350": ("Voron 2.4 350 0.4 nozzle", "V2 350"),
    "trident-250": ("Voron Trident 250", "Voron Trident"), "trident-300": ("Voron Trident 300 0.4 nozzle",),
    "trident-350": ("Voron_Trident_350",), "sv08": ("Sovol SV08", "Sovol SV08 0.4 nozzle"),
    "qidi-q1-pro": ("Qidi Q1 Pro", "Qidi Q1 Pro 0.4 nozzle"),
    "qidi-x-plus3": ("Qidi X-Plus 3", "QIDI X-Plus 3 0.4 nozzle"),
    "neptune4": ("Elegoo Neptune 4", "Elegoo Neptune 4 Pro 0.4 nozzle", "NEPTUNE4PRO"),
    "neptune4-plus": ("Elegoo Neptune 4 Plus (0.4 nozzle)",), "neptune4-max": ("Elegoo Neptune 4 Max 0.4 nozzle",),
    "kobra2": ("Anycubic Kobra 2", "Anycubic Kobra 2 0.4 nozzle"), "kobra-s1": ("Anycubic Kobra S1 0.4 nozzle",),
    "v-core3-300": ("RatRig V-Core 3 300", "RatRig V-Core 3 300 0.4 nozzle", "Rat Rig V-Core 3.1"),
    "v-core3-400": ("RatRig V-Core 3 400", "V-Core 3.1 400"), "v-core3-500": ("RatRig V-Core 3 500",),
}  # fmt: skip


def is_refused(preset: str, *names: str) -> bool:
    printer = read_printer(preset)
    try:
        refuse_contradiction("part.gcode", Described(names, None), printer)
    except ModelError as error:
        return "--force" in error.todo and error.came in [f"G-code for {name}" for name in names]
    return False


@pytest.mark.parametrize("preset", sorted({*preset_names()} - {"corexy"}))
def test_a_file_that_names_another_printer_is_refused(preset):
    passed = [name for name in FOREIGN if not is_refused(preset, name)]
    assert passed == [name for name in FOREIGN if name in SHARED.get(preset, ())]


@pytest.mark.parametrize("preset", preset_names())
def test_a_name_that_says_nothing_is_not(preset):
    assert [name for name in SILENT if is_refused(preset, name)] == []


@pytest.mark.parametrize("preset", OWN)
def test_a_printer_is_itself_by_all_its_names(preset):
    assert [name for name in OWN[preset] if is_refused(preset, name)] == []


def test_a_printer_with_a_name_of_its_own_is_known_by_its_numbers():
    cellar = replace(read_printer("ender3"), name="Cellar")
    longer = replace(cellar, x=replace(cellar.x, max_mm=cellar.x.max_mm + 100))
    assert "names ENDER5; if that is not Cellar" in other_printer_words(Described(("ENDER5",), None), cellar)
    for name, printer in (("Creality Ender-3", cellar), ("something else", cellar), ("ENDER5", longer)):
        assert other_printer_words(Described((name,), None), printer) is None


def test_presets_are_other_printers_but_for_upgrades_of_the_same_bed_and_belts():
    one, same_core = {"ender3", "ender3-s1", "ender3-v2"}, {"k1", "k1c"}
    for mine, other in product(preset_names(), repeat=2):
        same = mine == other or {mine, other} <= one or {mine, other} <= same_core or "corexy" in (mine, other)
        assert is_refused(mine, read_printer(other).name) != same, (mine, other)
    for siblings, kinematics in ((one, "cartesian"), (same_core, "corexy")):
        printers = [read_printer(preset) for preset in siblings]
        assert {(printer.kinematics, printer.x.max_mm, printer.x.mm_per_step) for printer in printers} == {
            (kinematics, printers[0].x.max_mm, printers[0].x.mm_per_step)
        }


@pytest.mark.parametrize("preset", preset_names())
def test_a_preset_names_its_source_and_is_known_by_its_own_name(preset):
    first = preset_text(preset).splitlines()[0]
    assert first.startswith("# Source: ")
    assert preset == "corexy" or len(printers_named(read_printer(preset).name)) == 1


def test_one_name_of_its_own_is_enough():
    assert not is_refused("ender5", "ENDER3", "Bob's Ender-5")
    assert not is_refused("aquila", "ENDER3V2", "Voxelab Aquila 0.4")
    assert is_refused("ender5", "ENDER3", "Bob's")


def test_a_printer_that_its_owner_named_takes_any_name():
    mine = replace(read_printer("ender5"), name="workhorse")
    for name in FOREIGN:
        refuse_contradiction("part.gcode", Described((name,), None), mine)
    assert printers_named("/home/voron/ender5/workhorse.toml") == frozenset()
    assert printers_named(r"C:\printers\ender5.toml") == printers_named("Ender-5") != frozenset()


def test_a_name_may_be_ambiguous():
    assert printers_named("X1") == {"artillery sidewinder", "bambu lab x1"}
    assert printers_named("MINI") == {"prusa mini", "lulzbot mini"}
    assert printers_named("Creality") > printers_named("CR-10") | printers_named("K1C")
    assert printers_named("Ender-30") == printers_named("Ender") > printers_named("Ender-3")
    assert printers_named("Original Prusa i3 MK2.5S") == {"prusa mk2"}
    assert bare_name("/a/My-Printer 2.toml") == "myprinter2toml"
