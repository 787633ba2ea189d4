"""The log of a job: its lines, what engines print, and the error that it ended with."""

import atexit
import gc
import logging
import os
import sys
from pathlib import Path

from workflow.run import lock

log = logging.getLogger(__name__)

GARBAGE_AFTER = 50_000  # containers that are made between two searches for garbage
# Scripts import this module first (pyproject.toml). Else Python would search what modules hold for garbage again and
# again while they load, and once more when it ends: a third of the time that torch takes to load.
gc.disable()


def _keep_garbage() -> None:
    """Skip the search for garbage when the process ends. Blender ends itself when its module is freed as such."""
    if "bpy" not in sys.modules:
        gc.freeze()


def log_to(path: Path | str) -> None:
    """Send a job's log lines, what engines print, and the traceback of a failure to its log file.

    To be called when all is imported. The last line of a job that failed is its error in one line. Standard error stays
    on the terminal, for the progress bar and for that line. The process counts as a job of the run in whose folder it
    is, until it ends (`lock`).
    """
    gc.set_threshold(GARBAGE_AFTER)
    gc.enable()
    atexit.register(_keep_garbage)
    if Path(lock.LOCK).exists():
        lock.share(".")
    file = open(path, "w", buffering=1)  # noqa: SIM115 - it lives as long as the process
    logging.basicConfig(stream=file, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", force=True)
    logging.captureWarnings(True)
    sys.stdout.flush()
    os.dup2(file.fileno(), 1)

    def excepthook(kind, error, traceback):
        from palpate.batch import one_line_error

        log.critical("stopped", exc_info=(kind, error, traceback))
        run_shows_error = "TQDM_DISABLE" in os.environ  # set by a run that has the terminal (`hooks.catch_signals`)
        try:
            print(one_line_error(error), flush=True)
        except OSError:  # a full disk: the run finds nothing in the log
            run_shows_error = False
        if not run_shows_error:
            print(one_line_error(error), file=sys.stderr)

    sys.excepthook = excepthook
