"""Episodes of the one-print environments as files that other programs read: Minari's format, and LeRobot's."""

from printmend_lab.offline.episodes import Episode, record
from printmend_lab.offline.lerobot import write_lerobot
from printmend_lab.offline.minari import write_minari

__all__ = ["Episode", "record", "write_lerobot", "write_minari"]
