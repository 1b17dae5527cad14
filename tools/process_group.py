"""Ends a process with all that it has started."""

import os
import signal
import subprocess


def end(process: subprocess.Popen) -> None:
    """Ends the process and its group, and waits for it. It must have been started with `start_new_session=True`."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
