"""The digital twin of a broken printer, compiled."""

from printmend.twin.twin import Twin, lattice_bed, lattice_tables

__all__ = ["Twin", "lattice_bed", "lattice_tables"]
