"""Filaments: how much parts shrink in them, and what of a print's scale is the machine's."""

from printmend.filament.ledger import CLAIM_SD, Entry, Split, split
from printmend.filament.material import Material, check_name, material_of

__all__ = ["CLAIM_SD", "Entry", "Material", "Split", "check_name", "material_of", "split"]
