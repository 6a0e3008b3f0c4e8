"""The program `printmend`, also as `python -m printmend`: its commands, and a quiet end while they are imported."""

import os
import signal


def main() -> None:
    """Run the command line. Ctrl-C ends it with 130, as it does everywhere else, from the first import on."""
    if (handler := signal.getsignal(signal.SIGINT)) is signal.default_int_handler:  # else a shell had it ignored
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))
    from printmend.cli.main import main as run

    signal.signal(signal.SIGINT, handler)
    run()


if __name__ == "__main__":
    main()
