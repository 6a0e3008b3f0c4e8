"""What one user may take of a studio that several use: bytes on its disk, and jobs that wait.

Only users have these bounds. Who sees everything has the studio's own.
"""

from printmend.errors import InputError
from printmend.messages import say
from printmend.studio.store import Store

SHARE = 0.5  # of the studio's bytes, for one user
MOST_WAITING = 100  # jobs of one user


def check_bytes(store: Store, most_bytes: int, more_bytes: int = 0) -> None:
    """Raise `InputError` where ``more_bytes`` are too many for the store, of ``most_bytes`` in all, or for its user."""
    held, own = store.held()
    if held + more_bytes > most_bytes:
        raise InputError(
            say("subject-studio"), wanted=say("most-gb-folder", f"{most_bytes / 1e9:g}"),
            came=say("gb", f"{held / 1e9:.1f}"), todo=say("free-some-under-storage"),
        )  # fmt: skip
    if store.owner is not None and own + more_bytes > most_of(store, most_bytes):
        raise InputError(
            store.owner, wanted=say("most-gb-user", f"{most_of(store, most_bytes) / 1e9:g}"),
            came=say("gb", f"{own / 1e9:.1f}"), todo=say("free-some-under-storage"),
        )  # fmt: skip


def check_jobs(store: Store) -> None:
    """Raise `InputError` where a user has as many jobs waiting as one may have."""
    if store.owner is None:
        return
    mine = sum(job["owner"] == store.owner for job in store.jobs(waiting=True))
    if mine >= MOST_WAITING:
        raise InputError(store.owner, wanted=say("fewer-jobs-user", MOST_WAITING), came=f"{mine}",
                         todo=say("wait-or-stop-some"))  # fmt: skip


def most_of(store: Store, most_bytes: int) -> int:
    """Return how many of the studio's bytes are for whoever sees this store."""
    return most_bytes if store.owner is None else int(SHARE * most_bytes)
