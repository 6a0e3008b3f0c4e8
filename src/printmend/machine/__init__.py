"""A machine as arrays, with one forward law for each of its effects; x, y and Z are motors of one machine.

`Mechanism` is the value that corruptions lower to, learners produce, twins run and planners invert. `lattice_tables`
puts it on the full-step lattice, `print_path` prints way-points in mm. The laws themselves are scalar functions in
`printmend.machine.kernels`.
"""

from printmend.machine.lattice import (
    LatticeMotor,
    LatticeScrew,
    PlayTables,
    lattice_bed,
    lattice_screw,
    lattice_tables,
    run_motors,
    run_screw,
)
from printmend.machine.mechanism import (
    BedMap,
    Frame,
    GainMechanism,
    Mechanism,
    ScrewDrive,
    Transmission,
    healthy_mechanism,
    healthy_transmission,
    homed_again,
    z_grid_mm,
)
from printmend.machine.printing import (
    Contacts,
    contacts_from,
    contacts_of,
    drive_belts,
    print_from_home,
    print_path,
    reach_bed,
    share_behind,
)

__all__ = [
    "BedMap",
    "Contacts",
    "Frame",
    "GainMechanism",
    "LatticeMotor",
    "LatticeScrew",
    "Mechanism",
    "PlayTables",
    "ScrewDrive",
    "Transmission",
    "contacts_from",
    "contacts_of",
    "drive_belts",
    "healthy_mechanism",
    "healthy_transmission",
    "homed_again",
    "lattice_bed",
    "lattice_screw",
    "lattice_tables",
    "print_from_home",
    "print_path",
    "reach_bed",
    "run_motors",
    "run_screw",
    "share_behind",
    "z_grid_mm",
]
