"""Snakemake's logger of a run (`logger: palpate` in the profiles): one line of progress in place of a page a job.

Snakemake finds a logger by such a package's name on Python's path, where `make env` puts this checkout. Each command
of Snakemake imports it, so that it loads little. Records are documented in `snakemake_interface_logger_plugins`.
"""

import logging
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase

from palpate.viewer import duration
from snakemake_logger_plugin_palpate.estimate import Estimate

SECONDS_BETWEEN_LINES = 60.0  # where the output is no terminal, and a line can't be written over
PAGES = {"job_info", "job_started", "job_finished", "progress", "shellcmd", "group_info", "job_error", "group_error"}
FILE_ERRORS = {"OSError", "PermissionError", "FileNotFoundError", "NotADirectoryError", "IsADirectoryError"}
UNKNOWN_TARGETS = {
    "MissingRuleException": re.compile(r"No rule to produce (.+?) \(if you use input functions"),
    "MissingInputException": re.compile(r"Missing input files for rule (?:all|\S*/\S*):\n(?:.*\n)*?\s+(\S.*)\Z"),
}
KILLED = "it was killed, as the system does where memory is short: start again with fewer --cores"
CRASHED = "a library crashed, as some do where memory is short: start again with fewer --cores, or free some memory"
ENDED_BY_SIGNAL = {
    re.compile(r"SIGKILL|exit status 137"): KILLED,
    re.compile(r"SIG(?:ABRT|SEGV|BUS)|exit status 13[459]"): CRASHED,
}
# What Snakemake repeats at the end of a run.
REPEATED = re.compile(r"(WorkflowError:\s+)?At least one job did not complete|Exiting because a job|Elapsed time: ")
INTERRUPTED = "interrupted; the same command goes on"
FILE_CLOCK = 1.0  # s by which the time of a file may be behind the clock: kernels stamp files by their last tick


class Failure(NamedTuple):
    """A job that failed: its rule, its first output, its log, and the error in one line."""

    rule: str
    output: str
    log: str
    error: str

    def __str__(self) -> str:
        error, log = f": {self.error}" if self.error else "", f" (log: {self.log})" if self.log else ""
        return f"failed: {self.rule} {self.output}{error}{log}"


class LogHandler(LogHandlerBase):
    """Shows records as Snakemake does, and from the start of a run one line of progress and a line for each failed job.

    With --dry-run, --printshellcmds or --verbose it shows all that Snakemake does; with --quiet all, errors alone.

    Attributes:
        current: the handler in use, for the Snakefile; None with another logger.
        explain: from the path of a target that nothing makes to the message about it; the Snakefile sets it.
        estimate: of the run; None before it starts. done: how many jobs. failures: jobs, in order. interrupted.
        silent: with --quiet all.
    """

    writes_to_stream = True
    writes_to_file = has_filter = has_formatter = needs_rulegraph = False  # Snakemake's filter and formatter apply
    current: "LogHandler | None" = None

    def __post_init__(self) -> None:
        settings = self.common_settings
        self.stream = sys.stdout if settings.stdout else sys.stderr
        self.rewrites = self.stream.isatty()
        self.colours = self.rewrites and not settings.nocolor and os.environ.get("TERM") != "dumb"
        self.silent = "all" in map(str, settings.quiet or ()) and not settings.dryrun
        self.quiet = self.silent or not (settings.dryrun or settings.printshellcmds or settings.verbose)
        self.explain: Callable[[str], str] = lambda path: f"no target {path}"
        self.estimate: Estimate | None = None
        self.done, self.failures, self.outputs = 0, [], {}
        self.signalled = ""  # what to say of the job whose error comes next
        self.interrupted, self.ended, self.began = False, threading.Event(), time.time()
        LogHandler.current = self

    def begin(self, jobs: Mapping[str, int], now: Callable[[], float] = time.monotonic) -> None:
        """The run starts. jobs: how many there are of each rule."""
        self.estimate, self.total = Estimate(jobs, now), sum(jobs.values())
        if self._has_line():
            threading.Thread(target=self._write_repeatedly, daemon=True).start()

    def filter(self, record: logging.LogRecord) -> bool:
        """As Snakemake's, but with --quiet all that keeps back every record: those of errors and of jobs, too."""
        return self.silent or super().filter(record)

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record, or count it."""
        try:
            self._clear()
            if self._is_shown(record):
                self._print(record)
            self.write(over=True)
        except Exception:
            self.handleError(record)

    def _is_shown(self, record: logging.LogRecord) -> bool:
        """Whether a record is printed; counts it, too."""
        if reached := getattr(record, "reached", None):
            reached.set()
            return False
        if self.interrupted:
            return record.msg == INTERRUPTED
        event, exception = str(getattr(record, "event", "")), getattr(record, "exception", "")
        self._shorten(record, exception)
        self._count(event, record)
        if not self.silent and (not self.estimate or not self.quiet or event == "run_info"):
            return True
        if exception == "RuleException":  # it has the job's command line and its exit status, and no more
            reasons = (text for pattern, text in ENDED_BY_SIGNAL.items() if pattern.search(str(record.msg)))
            self.signalled = next(reasons, "")
        if event in PAGES or exception == "RuleException" or REPEATED.match(str(record.msg).strip()):
            return False
        if self.silent:
            return record.levelno >= logging.ERROR
        return record.levelno >= logging.WARNING or self.ended.is_set()

    def _shorten(self, record: logging.LogRecord, exception: str) -> None:
        """Make one line of an unknown target, and of a file that Snakemake can't write or read."""
        text = str(record.msg).strip()
        if match := exception in UNKNOWN_TARGETS and UNKNOWN_TARGETS[exception].search(text):
            record.msg = self.explain(match[1])
        elif exception in FILE_ERRORS:  # it comes with its traceback
            record.msg = text.splitlines()[-1]
        elif exception == "RecursionError" and "overwrite_config" in text:  # Snakemake's, before the workflow is read
            record.msg = (
                "a file of --configfile contains itself, or is nested too deep: `palpate check <file>` says where"
            )

    def _count(self, event: str, record: logging.LogRecord) -> None:
        """Count the jobs that a record says to begin, end or fail."""
        if event == "run_info" and not self.common_settings.dryrun:
            self.begin({rule: count for rule, count in record.stats.items() if rule != "total"})
        elif self.estimate and event == "job_info":
            self.estimate.begin(record.jobid, record.rule_name)
            self.outputs[record.jobid] = next(iter(record.output or record.log or []), record.rule_name)
        elif self.estimate and event == "job_finished":
            self.done += 1
            self.estimate.end(record.job_id)
            self.outputs.pop(record.job_id, None)
        elif self.estimate and event == "job_error":
            self._fail(record)

    def _fail(self, record: logging.LogRecord) -> None:
        """Keep a failed job, and print it at once if only failures are shown."""
        self.estimate.end(record.jobid, done=False)
        self.outputs.pop(record.jobid, None)
        log = next(iter(record.log or []), "")
        executor = (getattr(record, "rule_msg", None) or "ended from outside").strip().splitlines()[0]  # a cluster's
        fresh = log and os.path.exists(log) and os.path.getmtime(log) > self.began - FILE_CLOCK  # else of a run before
        error, self.signalled = self.signalled or (last_line(log) if fresh else "") or executor, ""
        output = str(next(iter(record.output or []), record.rule_name))
        self.failures.append(Failure(record.rule_name, output, os.path.abspath(log) if log else "", error))
        if self.quiet:
            print(self.failures[-1], file=self.stream, flush=True)

    def _print(self, record: logging.LogRecord) -> None:
        """Print a record, in colour on a terminal."""
        text, event = self.format(record), str(getattr(record, "event", ""))
        if text in ("", "None"):  # as of Snakemake's records that are for loggers only
            return
        if self.colours:
            colour = 31 if record.levelno >= logging.ERROR else 32 if event.startswith(("job", "progress")) else 33
            text = f"\033[{colour}m{text}\033[0m"
        print("\n" * (event == "job_info") + text, file=self.stream, flush=True)

    def line(self) -> str:
        """Jobs done, failed and in all, the time so far, an estimate of the time left, and what runs now."""
        estimate = self.estimate.seconds()
        failed = f", {len(self.failures)} failed" if self.failures else ""
        left = f", about {duration(estimate)} left" if estimate is not None else ""
        running = f"; now {', '.join(map(str, self.outputs.values()))}" if self.outputs else ""
        so_far = duration(self.estimate.so_far())
        return f"{self.done} of {self.total} jobs done{failed}, {so_far} so far{left}{running}"

    def write(self, over: bool = False) -> None:
        """The line of progress of a run, on a terminal over the one before. over: write on a terminal only."""
        with self.lock:
            if not self._has_line() or (over and not self.rewrites):
                return
            if self.rewrites:
                width = shutil.get_terminal_size().columns - 1
                print(f"\r\033[K{self.line()[:width]}", end="", file=self.stream, flush=True)
            else:
                print(self.line(), file=self.stream, flush=True)

    def _write_repeatedly(self) -> None:
        """Write the line of progress until the run ends."""
        while not self.ended.wait(1.0 if self.rewrites else SECONDS_BETWEEN_LINES):
            self.write()

    def interrupt(self) -> None:
        """The run is to end: from now on nothing of its jobs is shown."""
        self.interrupted = True
        self.stop()
        print("stopping the jobs that run", file=self.stream, flush=True)

    def stop(self) -> None:
        """End the line of progress. What Snakemake says of the run as a whole is shown again."""
        with self.lock:
            self._clear()
            self.ended.set()

    def close(self) -> None:
        """The end of Snakemake's logging."""
        self.ended.set()
        LogHandler.current = None if LogHandler.current is self else LogHandler.current
        super().close()

    def _has_line(self) -> bool:
        """Whether there is a line of progress: from the run's start to its end, unless more or nothing is shown."""
        return bool(self.estimate) and self.quiet and not self.silent and not self.ended.is_set()

    def _clear(self) -> None:
        """Remove the line of progress from a terminal."""
        if self.rewrites and self._has_line():
            print("\r\033[K", end="", file=self.stream, flush=True)


def last_line(path: Path | str) -> str:
    """The last line of a job's log that is not blank, without its traceback; empty if there is none."""
    try:
        text = Path(path).read_bytes()[-100_000:].decode(errors="replace")
    except OSError:
        return ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""
