"""What the Snakefile's hooks do: signals from the start of a run on, its page and summary at its end."""

import contextlib
import gc
import itertools
import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from importlib import metadata
from pathlib import Path

import psutil
from snakemake.logging import logger

from palpate import __version__, atomic
from palpate.batch import one_line_error
from palpate.viewer import duration
from snakemake_logger_plugin_palpate import INTERRUPTED, LogHandler

VERSIONS = ("snakemake", "mujoco", "bpy", "trimesh", "numpy", "zarr", "torch")  # that a run's page names


def prepare(project: Path) -> None:
    """Set this process and its jobs up, before the workflow is planned."""
    sys.excepthook = excepthook
    # Jobs find Palpate in this checkout, also in an environment that has only its dependencies (envs/palpate.yaml).
    os.environ["PYTHONPATH"] = os.pathsep.join([str(project), *filter(None, [os.environ.get("PYTHONPATH")])])
    # Jobs have one thread each. Snakemake limits OpenMP and BLAS by itself; libigl would take every core.
    os.environ.setdefault("IGL_NUM_THREADS", "1")
    # A plan is millions of Python objects that stay. To look for cycles among them again and again takes a sixth of the
    # time of planning 100,000 objects.
    gc.set_threshold(200_000, 50, 100)


def excepthook(kind: type[BaseException], error: BaseException, traceback) -> None:
    """As `sys.excepthook`, but an interrupt before the run starts is one line."""
    if issubclass(kind, KeyboardInterrupt):
        print(INTERRUPTED, file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, traceback)


def end_at_signals() -> None:
    """Let SIGTERM end this process as Ctrl-C does. Snakemake waits for jobs, of which none is started yet."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def catch_signals() -> None:
    """Let Ctrl-C and SIGTERM end the jobs, and then the run. Jobs ignore Ctrl-C themselves (`shell.prefix`)."""

    def interrupt(*_) -> None:
        if not LogHandler.current.interrupted:
            LogHandler.current.interrupt()
            threading.Thread(target=_end_children, daemon=True).start()
            raise KeyboardInterrupt

    if LogHandler.current:
        for ending in (signal.SIGINT, signal.SIGTERM):
            signal.signal(ending, interrupt)
        if LogHandler.current.quiet:
            os.environ["TQDM_DISABLE"] = "1"  # the terminal is the run's: jobs write their logs only


def _end_children() -> None:
    """End all processes that this one has started, and that are started meanwhile, until it ends itself."""
    for attempt in itertools.count():
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                process.terminate() if attempt < 10 else process.kill()
        time.sleep(0.3)


def finish(folder: str, object_pages: int) -> None:
    """Write the page of a run that ends, and say what it has come to. object_pages: how many are written with it."""
    from palpate.dataset import summary  # loads Zarr and HDF5

    signal.signal(signal.SIGINT, signal.default_int_handler)
    for thread in threading.enumerate():  # Snakemake's for its limit of jobs, for which it would wait before it ends
        if isinstance(thread, threading.Timer):
            thread.cancel()
    if handler := LogHandler.current:
        logger.info(None, extra={"reached": (reached := threading.Event())})
        reached.wait(10)  # until the handler, in its own thread, has counted all jobs
        handler.stop()
        if handler.interrupted:
            return logger.warning(INTERRUPTED)
    if Path(folder, "catalogue.csv").exists() or (handler and handler.failures):
        _write_page(folder, object_pages, handler)
    places = ("index.html", "tables", "figures", "rejected.csv", "reports")
    existing = [place for place in places if Path(folder, place).exists()]
    try:
        lines = summary(folder)
    except Exception as error:  # a table that was changed, and what to do
        lines = [one_line_error(error)]
    for line in [*lines, f"{folder}: {', '.join(existing) or 'no table or report yet'}"]:
        logger.warning(line)
    if handler and handler.estimate:  # with --quiet Snakemake does not say which jobs there are
        failed = f", {len(handler.failures)} failed" if handler.failures else ""
        logger.warning(f"{handler.done} jobs done{failed}, in {duration(handler.estimate.so_far())}")


def commit() -> dict[str, str]:
    """Git's commit of this folder as `commit`, with `-dirty` after it if files have changed since; {} without Git."""
    command = ["git", "-C", Path(__file__).parent, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        return {"commit": subprocess.run(command, capture_output=True, check=True, text=True).stdout.strip()}
    except (OSError, subprocess.CalledProcessError):
        return {}


def version(package: str) -> str:
    """The version of a package that is installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _write_page(folder: str, object_pages: int, handler: LogHandler | None) -> None:
    """index.html, and what it says of this start: last_run.json. No file of the workflow depends on them."""
    from palpate.viewer import run_page

    try:
        if handler and (handler.done or handler.failures):  # else this start says nothing of how the run was made
            last = {
                "ended": time.strftime("%Y-%m-%d %H:%M"),
                "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
                "jobs": handler.done,
                "seconds": round(handler.estimate.so_far()),
                "failures": handler.failures,
                **commit(),
                "versions": {"palpate": __version__} | {name: version(name) for name in VERSIONS},
            }
            with atomic.atomic_write(f"{folder}/last_run.json") as path:
                path.write_text(json.dumps(last, indent=1) + "\n")
        run_page(folder, object_pages=object_pages)
    except Exception as error:
        logger.warning(f"{folder}/index.html was not written: {one_line_error(error)}")
