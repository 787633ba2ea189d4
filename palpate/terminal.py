"""What a run prints on the terminal: errors in plain lines, one line of progress, and unknown targets with those known.

It reads the records of Snakemake's logger by their fields (`event`, `exception`, ...), and needs no Snakemake.
"""

import difflib
import logging
import os
import re
import shutil
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, TextIO

FILE_ERRORS = {"OSError", "PermissionError", "FileNotFoundError", "NotADirectoryError", "IsADirectoryError"}
SECONDS_BETWEEN_LINES = 60.0  # where the output is no terminal, and a line can't be written over

KILLED = re.compile(r"SIGKILL|exit status 137")
KILLED_SAID = "it was killed, as the system does where memory is short: start again with fewer --cores"
# What Snakemake adds at the end of a run, where jobs that failed have a line each and the time is told.
SAID_AGAIN = re.compile(
    r"(WorkflowError:\s+)?At least one job did not complete|Exiting because a job exec|Elapsed time: "
)
INTERRUPTED = "interrupted; the same command goes on"
OVERDUE = 0.1  # share of its time so far that a job is taken to need still, if it has run longer than its rule's others


class Failure(NamedTuple):
    """A job that failed: its rule, its first output, its log, and what it says last."""

    rule: str
    output: str
    log: str
    said: str


def unknown_target(path: str, known: Iterable[str], notes: Sequence[str] = ()) -> str:
    """The message for a target that nothing makes: the nearest of those that there are, then the notes, a line each."""
    close = difflib.get_close_matches(path, list(known), n=3, cutoff=0.5)
    hint = f"; did you mean {' or '.join(close)}?" if close else ""
    return "\n".join([f"no target {path}{hint}", *(f"  {note}" for note in notes)])


class Errors(logging.Filter):
    """Rewrites Snakemake's errors in plain lines, for any handler; other records pass as they are.

    These are unknown targets, and files that Snakemake itself can't write or read.
    explain: the message for the path of a target that nothing makes.
    """

    PATTERNS = {
        "MissingRuleException": re.compile(r"No rule to produce (.+?) \(if you use input functions"),
        "MissingInputException": re.compile(r"Missing input files for rule (?:all|\S*/\S*):\n(?:.*\n)*?\s+(\S.*)\Z"),
    }

    def __init__(self, explain: Callable[[str], str]):
        super().__init__()
        self.explain = explain

    def filter(self, record: logging.LogRecord) -> bool:
        kind, text = getattr(record, "exception", ""), str(record.msg).strip()
        pattern = self.PATTERNS.get(kind)
        match = pattern and pattern.search(text)
        if match:
            record.msg = self.explain(match[1])
        elif kind in FILE_ERRORS:  # printed with its traceback
            record.msg = text.splitlines()[-1]
        return True


def excepthook(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    """As `sys.excepthook`, but an interrupt is one line."""
    if issubclass(kind, KeyboardInterrupt):
        print(INTERRUPTED, file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, traceback)


def last_line(path: Path | str) -> str:
    """The last line of a job's log that is not blank, without its traceback; empty if there is none."""
    try:
        text = Path(path).read_bytes()[-100_000:].decode(errors="replace")
    except OSError:
        return ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""


def duration(seconds: float) -> str:
    """Hours, minutes, or seconds, as one reads them: `1 h 20 min`, `3 min 5 s`, `12 s`."""
    seconds = round(seconds)
    if seconds >= 3600:
        return f"{seconds // 3600} h {seconds % 3600 // 60} min"
    return f"{seconds // 60} min {seconds % 60} s" if seconds >= 60 else f"{seconds} s"


class Estimate:
    """The time that a run has left, from the jobs of each rule that it has done.

    jobs: how many there are of each rule. now: a clock in seconds.
    """

    def __init__(self, jobs: Mapping[str, int], now: Callable[[], float] = time.monotonic):
        self.left, self.now, self.start = Counter(jobs), now, now()
        self.running: dict[int, tuple[str, float]] = {}
        self.took: dict[str, list[float]] = {}

    def begin(self, job: int, rule: str) -> None:
        """A job starts."""
        self.running[job] = rule, self.now()

    def end(self, job: int, done: bool = True) -> None:
        """A job ends; one that was not done says nothing of the time that others take."""
        rule, start = self.running.pop(job, ("", 0.0))
        self.left[rule] -= 1
        if done and rule:
            self.took.setdefault(rule, []).append(self.now() - start)

    def seconds(self) -> float | None:
        """Seconds left; None as long as no job is done.

        Each job that is left takes the mean time of its rule's, or of all if none of its rule is done. A running job
        that has taken longer counts among its rule's with `OVERDUE` more than its time so far. The jobs that run side
        by side are those that have run so on average, and the time left is at least that of the longest.
        """
        times = [each for times in self.took.values() for each in times]
        elapsed = self.now() - self.start
        if not times or elapsed <= 0:
            return None
        overall = sum(times) / len(times)
        mean = {rule: sum(took) / len(took) for rule, took in self.took.items()}
        ages = [(rule, self.now() - start) for rule, start in self.running.values()]
        for rule in {rule for rule, _ in ages}:
            late = [(1 + OVERDUE) * age for each, age in ages if each == rule and age > mean.get(rule, overall)]
            expected = self.took.get(rule, []) + late
            mean[rule] = sum(expected) / len(expected) if expected else overall
        left = [max(mean[rule] - age, OVERDUE * age) for rule, age in ages]
        waiting = Counter(self.left) - Counter(rule for rule, _ in ages)
        work = sum(left) + sum(count * mean.get(rule, overall) for rule, count in waiting.items())
        side_by_side = max(1.0, (sum(times) + sum(age for _, age in ages)) / elapsed)
        return max(work / side_by_side, *left, 0.0)


class Progress(logging.Filter):
    """On the terminal's handler, one line in place of a page for each job; failed jobs in a line each.

    jobs: how many there are of each rule. stream: the terminal, or a file. Attributes: failures, in their order.
    """

    PAGES = {
        "job_info",
        "job_started",
        "job_finished",
        "progress",
        "shellcmd",
        "group_info",
        "job_error",
        "group_error",
    }

    def __init__(
        self, jobs: Mapping[str, int], stream: TextIO | None = None, now: Callable[[], float] = time.monotonic
    ):
        super().__init__()
        self.stream = stream or sys.stderr
        self.estimate, self.total = Estimate(jobs, now), sum(jobs.values())
        self.done, self.failures, self.outputs = 0, [], {}
        self.killed = False  # the job whose error comes next
        self.interrupted = False
        self.rewrites, self.began = self.stream.isatty(), time.time()
        self.lock, self.ended = threading.RLock(), threading.Event()

    def start(self) -> None:
        """Write the line again and again in the background, until `stop`."""
        threading.Thread(target=self._keep, daemon=True).start()

    def _keep(self) -> None:
        while not self.ended.wait(1.0 if self.rewrites else SECONDS_BETWEEN_LINES):
            self.write()

    def interrupt(self) -> None:
        """The run is asked to end: from now on nothing of its jobs is written."""
        self.interrupted = True
        self.ended.set()
        with self.lock:
            self._clear()
            print("stopping the jobs that run", file=self.stream, flush=True)

    def stop(self) -> None:
        """Write no more; the line is cleared."""
        self.ended.set()
        with self.lock:
            self._clear()

    def filter(self, record: logging.LogRecord) -> bool:
        event = getattr(record, "event", None)
        kind = str(getattr(event, "value", event))
        if self.interrupted:
            return record.msg == INTERRUPTED
        with self.lock:
            self._clear()
            if kind == "job_info":
                self.estimate.begin(record.jobid, record.rule_name)
                self.outputs[record.jobid] = next(iter(record.output or record.log or []), record.rule_name)
            elif kind == "job_finished":
                self.done += 1
                self.estimate.end(record.job_id)
                self.outputs.pop(record.job_id, None)
            elif kind == "job_error":
                self._fail(record)
            if kind in self.PAGES:
                if self.rewrites:
                    self.write()
                return False
        if getattr(record, "exception", None) != "RuleException":
            again = SAID_AGAIN.match(str(record.msg).strip())
            return not again and (record.levelno >= logging.WARNING or self.ended.is_set())
        self.killed = bool(KILLED.search(str(record.msg)))  # else it has the job's command line, and no more
        return False

    def _fail(self, record: logging.LogRecord) -> None:
        self.estimate.end(record.jobid, done=False)
        self.outputs.pop(record.jobid, None)
        log = next(iter(record.log or []), "")
        output = next(iter(record.output or []), record.rule_name)
        executor = (getattr(record, "rule_msg", None) or "ended from outside").strip().splitlines()[0]  # a cluster's
        fresh = log and os.path.exists(log) and os.path.getmtime(log) >= self.began  # else of a run before
        said, self.killed = KILLED_SAID if self.killed else (last_line(log) if fresh else "") or executor, False
        failure = Failure(record.rule_name, str(output), os.path.abspath(log) if log else "", said)
        self.failures.append(failure)
        print(failure_line(failure), file=self.stream, flush=True)

    def line(self) -> str:
        """Jobs done, failed and in all, the time so far, an estimate of the time left, and what runs now."""
        estimate, so_far = self.estimate.seconds(), self.estimate.now() - self.estimate.start
        failed = f", {len(self.failures)} failed" if self.failures else ""
        left = f", about {duration(estimate)} left" if estimate is not None else ""
        running = f"; now {', '.join(map(str, self.outputs.values()))}" if self.outputs else ""
        return f"{self.done} of {self.total} jobs done{failed}, {duration(so_far)} so far{left}{running}"

    def write(self) -> None:
        """The line, over the one before on a terminal."""
        with self.lock:
            if self.rewrites:
                width = shutil.get_terminal_size().columns - 1
                print(f"\r\033[K{self.line()[:width]}", end="", file=self.stream, flush=True)
            else:
                print(self.line(), file=self.stream, flush=True)

    def _clear(self) -> None:
        if self.rewrites:
            print("\r\033[K", end="", file=self.stream, flush=True)


def failure_line(failure: Failure) -> str:
    """A failed job in one line."""
    said = f": {failure.said}" if failure.said else ""
    return f"failed: {failure.rule} {failure.output}{said}" + (f" (log: {failure.log})" if failure.log else "")


def end_lines(folder: Path | str, of_objects: Iterable[str], failed: int, jobs: int, seconds: float) -> list[str]:
    """The lines at the end of a run: its objects, where its results are, how long it took. What failed stands above.

    of_objects: `palpate.dataset.summary`'s. failed, jobs: how many jobs failed, and were done.
    """
    folder = Path(folder)
    places = [place for place in ("index.html", "tables", "figures", "rejected.csv", "reports") if
              (folder / place).exists()]  # fmt: skip
    return [
        *of_objects,
        f"{folder}: {', '.join(places) or 'no table or report yet'}",
        f"{jobs} jobs done{f', {failed} failed' if failed else ''}, in {duration(seconds)}",
    ]
