"""The Z screw: heights, and how it pushes the layers about, from a print of three axes."""

from printmend.identify.screw.screw import Height, Push, first_push_mm, fit_height, fit_push, screw_drive

__all__ = ["Height", "Push", "first_push_mm", "fit_height", "fit_push", "screw_drive"]
