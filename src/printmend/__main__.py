"""`python -m printmend`: the commands, where the program `printmend` is not on the path."""

from printmend.cli.main import main

if __name__ == "__main__":
    main()
