"""The command `esaac`: `python -m esaac --help`."""

import signal
import sys

from esaac._native import run_command


def main():
    # Ctrl-C ends the command at once. Python's own handler would run only after the command.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    again = [sys.executable, "-m", "esaac"]
    sys.exit(run_command(["esaac", *sys.argv[1:]], again))


if __name__ == "__main__":
    main()
