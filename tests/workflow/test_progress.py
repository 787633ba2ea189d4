"""What a run prints: progress with an estimate, failures in a line, unknown targets, and the end."""

import io
import json
import logging
import logging.handlers
import os
import queue
import signal
import subprocess
import threading
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from snakemake.logging import DefaultFilter
from snakemake.settings.enums import Quietness
from snakemake_interface_logger_plugins.tests import MockOutputSettings, TestLogHandlerBase

from palpate.seal import DamagedFile
from palpate.viewer import duration
from snakemake_logger_plugin_palpate import INTERRUPTED, LogHandler, last_line
from snakemake_logger_plugin_palpate.estimate import Estimate
from workflow.run import hooks


class Clock:
    time = 0.0

    def __call__(self):
        return self.time


def handler(jobs, now=None, **settings):
    """A handler of a run that starts, which writes to its `stream`; settings as of the command line."""
    common = MockOutputSettings()
    vars(common).update({"printshellcmds": False} | settings)
    made = LogHandler(common, None)
    made.stream = io.StringIO()
    if jobs:
        made.begin(jobs, now or Clock())
    return made


def shown(made, record):
    """What a handler adds to its stream for a record, without the end of the line."""
    before = len(made.stream.getvalue())
    made.handle(record)
    return made.stream.getvalue()[before:].removesuffix("\n")


def record(event=None, level=logging.INFO, msg="", **fields):
    return logging.makeLogRecord({"levelno": level, "msg": msg, "event": event, **fields})


@pytest.mark.parametrize("side_by_side", [1, 2, 4])
def test_with_jobs_that_take_what_their_rule_takes_the_estimate_is_the_time_left(side_by_side):
    """40 jobs of two rules, in turn, on some cores: after each round of jobs, what is left by simple counting."""
    clock = Clock()
    estimate = Estimate({"short": 20, "long": 20}, clock)
    assert estimate.seconds() is None
    for number in range(0, 40, side_by_side):
        rule = "short" if number // side_by_side % 2 == 0 else "long"
        for job in range(number, number + side_by_side):
            estimate.begin(job, rule)
        clock.time += 3 if rule == "short" else 11
        for job in range(number, number + side_by_side):
            estimate.end(job)
        done = number // side_by_side + 1
        if done >= 2:
            shorts, longs = 20 // side_by_side - (done + 1) // 2, 20 // side_by_side - done // 2
            assert estimate.seconds() == pytest.approx(3 * shorts + 11 * longs)


def test_the_estimate_counts_what_a_running_job_has_done_and_no_failed_job():
    clock = Clock()
    estimate = Estimate({"a": 4}, clock)
    estimate.begin(0, "a")
    clock.time = 10
    estimate.end(0)
    estimate.begin(1, "a")
    clock.time = 14
    assert estimate.seconds() == pytest.approx(26)  # 6 of this one, two more
    estimate.end(1, done=False)
    assert estimate.seconds() == pytest.approx(20 * 14 / 14, rel=0.5) and estimate.took == {"a": [10]}


def test_the_estimate_moves_with_a_job_that_takes_longer_than_others():
    """Trainings after quick jobs: 3 of a rule of which nothing is known, of which the first runs on and on."""
    clock = Clock()
    estimate = Estimate({"quick": 1, "train": 3}, clock)
    estimate.begin(0, "quick")
    clock.time = 2
    estimate.end(0)
    estimate.begin(1, "train")
    found = []
    for clock.time in (3, 12, 22, 62, 302):
        found.append(estimate.seconds())
    assert found[0] == pytest.approx(5)  # 1 of this one, two more like the quick one
    assert found == sorted(set(found)) and found[-1] > 2 * 300  # the other two take as long
    estimate.end(1)
    assert estimate.seconds() == pytest.approx(2 * 300)


def test_the_time_left_is_at_least_that_of_the_job_that_runs_last():
    clock = Clock()
    estimate = Estimate({"a": 5}, clock)
    for job in range(4):
        estimate.begin(job, "a")
    clock.time = 100
    for job in range(4):
        estimate.end(job)
    estimate.begin(4, "a")
    clock.time = 110
    assert estimate.seconds() == pytest.approx(90)  # though four ran side by side before


# Seconds that a job of each rule took on average in a run of 240 objects, and how many there were, in the order in
# which they ran (docs/evidence/performance.md); trainings and evaluations as in the default run.
DATA = [
    *(("shapes", 3.5, 4), ("catalogue_batch", 0.5, 15), ("catalogue", 0.6, 1), ("meshes", 7.6, 15)),
    *(("surface", 1.9, 15), ("grasps", 6.6, 15), ("touch", 1.8, 15), ("vision", 23, 15)),
]
MODELS = [
    ("charts", 7.4, 15),
    ("touch_depth", 47, 1),
    ("reconstruction", 31, 34),
    ("evaluate", 18, 34),
    ("table", 1, 20),
]


@pytest.mark.parametrize("run", [DATA, DATA + MODELS], ids=["data", "models"])
@pytest.mark.parametrize("seed", range(3))
def test_the_estimate_is_about_right_before_the_long_rules_begin(run, seed):
    """From a tenth of the run on; before, quick jobs say nothing. A rule may take twice or half of the time there."""
    draw, clock, running = np.random.default_rng(seed), Clock(), []
    jobs = [
        (rule, took * factor) for rule, took, count in run for factor in [draw.uniform(0.5, 2)] for _ in range(count)
    ]
    estimate, said = Estimate(Counter(rule for rule, _ in jobs), clock), []
    for job, (rule, took) in enumerate(jobs):
        if len(running) == 2:  # cores
            clock.time, ended = running.pop(0)
            estimate.end(ended)
            said.append((clock.time, estimate.seconds()))
        estimate.begin(job, rule)
        running = sorted([*running, (clock.time + took, job)])
    total = running[-1][0]
    assert all(seconds is None for time, seconds in said if time < 0.01 * total)
    ratios = [seconds / (total - time) for time, seconds in said if 0.1 * total < time < 0.95 * total]
    assert min(ratios) > 1 / 2.5 and max(ratios) < 2.5


@pytest.mark.parametrize(("seconds", "said"), [(12.4, "12 s"), (185, "3 min 5 s"), (4800, "1 h 20 min")])
def test_durations_are_as_one_reads_them(seconds, said):
    assert duration(seconds) == said


class TestInterface(TestLogHandlerBase):
    """What Snakemake's interface asks of each logger."""

    __test__ = True

    def get_log_handler_cls(self):
        return LogHandler

    def get_log_handler_settings(self):
        return None


def test_progress_is_one_line_and_a_failure_is_one_line(tmp_path):
    clock = Clock()
    made = handler({"meshes": 3}, clock)
    log = tmp_path / "meshes.log"
    log.write_text("Traceback\n  ...\nx.zarr: the disk is full: free some space\n\n")
    pages = [
        record("job_info", jobid=1, rule_name="meshes", output=["meshes/batch-0000"], log=[str(log)]),
        record("job_info", jobid=2, rule_name="meshes", output=["meshes/batch-0001"], log=[str(log)]),
        record("job_finished", job_id=1),
        record("progress", done=1, total=3),
        record("error", logging.ERROR, "RuleException: exit status 1", exception="RuleException"),
        record("job_error", logging.ERROR, jobid=2, rule_name="meshes", output=["meshes/batch-0001"], log=[str(log)]),
        record(None, logging.INFO, "Select jobs to execute..."),
    ]
    for page in pages:
        clock.time += 10
        made.handle(page)
    assert made.stream.getvalue() == (
        f"failed: meshes meshes/batch-0001: x.zarr: the disk is full: free some space (log: {log})\n"
    )
    assert shown(made, record(None, logging.WARNING, "something else")) == "something else"
    assert made.line() == "1 of 3 jobs done, 1 failed, 1 min 10 s so far, about 20 s left"
    made.stop()
    assert shown(made, record(None, logging.INFO, "the end")) == "the end"


@pytest.mark.parametrize("option", ["printshellcmds", "verbose", "dryrun"])
def test_options_ask_for_a_page_a_job(option):
    made = handler({"meshes": 1}, **{option: True})
    assert shown(made, record("job_info", msg="rule meshes:", jobid=1, rule_name="meshes", output=["m"], log=[]))
    failed = record("job_error", logging.ERROR, "Error in rule meshes", jobid=1, rule_name="meshes", output=[], log=[])
    assert shown(made, failed) == "Error in rule meshes" and len(made.failures) == 1


def test_what_snakemake_says_again_at_the_end_is_omitted():
    made = handler({"meshes": 1})
    made.stop()
    for text in (
        "WorkflowError:\nAt least one job did not complete successfully.",
        "Exiting because a job execution failed. Look above for error messages",
        "Elapsed time: 0:00:21.319559",
    ):
        assert not shown(made, record(None, logging.ERROR, text))
    assert shown(made, record(None, logging.INFO, "Complete log(s): x"))


def test_an_interrupted_run_says_so_and_nothing_of_its_jobs():
    made = handler({"meshes": 1})
    made.interrupt()
    assert made.stream.getvalue() == "stopping the jobs that run\n"
    failed = record("job_error", logging.ERROR, jobid=1, rule_name="meshes", output=["m"], log=[])
    assert not shown(made, failed) and not made.failures
    assert not shown(made, record(None, logging.ERROR, "WorkflowError: x", exception="WorkflowError"))
    assert shown(made, record(None, logging.WARNING, INTERRUPTED)) == INTERRUPTED


def test_an_interrupt_before_the_run_is_one_line(capsys):
    hooks.excepthook(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert capsys.readouterr().err == f"{INTERRUPTED}\n"
    hooks.excepthook(ValueError, ValueError("as ever"), None)
    assert "ValueError: as ever" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("ended", "error"),
    [
        ("died with <Signals.SIGKILL: 9>.", "it was killed"),
        ("returned non-zero exit status 137.", "it was killed"),
        ("died with <Signals.SIGABRT: 6>.", "a library crashed"),  # as Blender's std::bad_alloc
        ("returned non-zero exit status 139.", "a library crashed"),
    ],
)
def test_a_job_that_a_signal_ended_says_so(ended, error):
    made = handler({"grasps": 1})
    made.handle(record("job_info", jobid=1, rule_name="grasps", output=["g.h5"], log=[]))
    made.handle(record("error", logging.ERROR, ended, exception="RuleException"))
    made.handle(record("job_error", logging.ERROR, jobid=1, rule_name="grasps", output=["g.h5"], log=[]))
    assert error in made.failures[0].error and "memory is short" in made.failures[0].error
    made.handle(record("job_error", logging.ERROR, jobid=2, rule_name="grasps", output=["h.h5"], log=[]))
    assert made.failures[1].error == "ended from outside"  # it had no time for a line in its log


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        ("MissingRuleException", "\nNo rule to produce a/b.csv (if you use input functions", "<a/b.csv>"),
        (
            "MissingInputException",
            "in rule results/x/t.csv in file ...:\nMissing input files for rule results/x/t.csv:\n"
            "    affected files:\n        t.csv",
            "<t.csv>",
        ),
        ("OSError", "Traceback\n\nOSError: [Errno 28] No space left on device: 'x'\n\n", "OSError: [Errno 28]"),
        ("WorkflowError", "as it is", "as it is"),
    ],
)  # fmt: skip
def test_errors_are_plain(kind, text, said):
    made = handler({})
    made.explain = lambda path: f"<{path}>"
    line = shown(made, record("error", logging.ERROR, text, exception=kind))
    assert line.startswith(said) and (said == "as it is" or "\n" not in line)


def test_a_package_that_is_not_installed_costs_no_page(monkeypatch, tmp_path):
    pages = []
    monkeypatch.setattr("palpate.viewer.run_page", lambda folder, **_: pages.append(folder))
    monkeypatch.setattr(hooks, "VERSIONS", ("numpy", "no-such-package"))
    made = SimpleNamespace(done=1, failures=[], estimate=SimpleNamespace(so_far=lambda: 3.2))
    hooks._write_page(str(tmp_path), 0, made)
    versions = json.loads((tmp_path / "last_run.json").read_text())["versions"]
    assert versions["numpy"] == np.__version__ and versions["no-such-package"] == "not installed"
    assert pages == [str(tmp_path)]


def test_the_last_line_of_a_log(tmp_path):
    (tmp_path / "log").write_bytes(b"one\n\xff two \n\n")
    assert last_line(tmp_path / "log").endswith("two") and last_line(tmp_path / "none") == ""


@pytest.mark.parametrize(("age", "error"), [(0.5, "of this run"), (3600, "ended from outside")])
def test_a_log_of_a_run_before_is_not_the_error_of_this_one(tmp_path, age, error):
    """A file's time may be a little before the clock's at which it was written."""
    made, log = handler({"meshes": 1}), tmp_path / "meshes.log"
    log.write_text("of this run\n")
    os.utime(log, (made.began - age, made.began - age))
    made.handle(record("job_error", logging.ERROR, jobid=1, rule_name="meshes", output=["m"], log=[str(log)]))
    assert made.failures[0].error == error


def test_of_a_job_that_a_cluster_refuses_its_word_is_passed_on(tmp_path):
    made = handler({"touch_depth": 2})
    message = "SLURM sbatch failed. The error message was 'Invalid generic resource'.\n    sbatch call: ..."
    fields = {"rule_name": "touch_depth", "output": ["best.ckpt"], "log": [str(tmp_path / "touch_depth.log")]}
    made.handle(record("job_error", logging.ERROR, jobid=1, rule_msg=message, **fields))
    made.handle(record("job_error", logging.ERROR, jobid=2, rule_msg=None, **fields))
    assert [each.error for each in made.failures] == [message.splitlines()[0], "ended from outside"]


def test_the_end_names_objects_places_and_time_and_counts_what_failed(tmp_path, monkeypatch):
    """With the handler in a thread of its own, as Snakemake has it: the end waits until all jobs are counted."""
    (tmp_path / "tables").mkdir()
    clock = Clock()
    made = handler({"meshes": 8}, clock)
    monkeypatch.setattr(hooks, "_write_page", lambda *_: None)
    monkeypatch.setattr("palpate.dataset.summary", lambda folder: ["objects: 3"])
    records = queue.Queue()
    logger = logging.getLogger("snakemake.logging")
    listener = logging.handlers.QueueListener(records, made)
    sender = logging.handlers.QueueHandler(records)
    monkeypatch.setattr(logger, "handlers", [sender])
    monkeypatch.setattr(logger, "level", logging.INFO)
    for job in range(7):
        logger.info("", extra={"event": "job_info", "jobid": job, "rule_name": "meshes", "output": ["m"], "log": []})
        logger.info("", extra={"event": "job_finished", "job_id": job})
    logger.error("", extra={"event": "job_error", "jobid": 7, "rule_name": "meshes", "output": ["m"], "log": []})
    clock.time = 61
    listener.start()
    before = signal.getsignal(signal.SIGINT)
    hooks.finish(str(tmp_path), object_pages=0)
    signal.signal(signal.SIGINT, before)
    listener.stop()
    assert made.stream.getvalue().splitlines()[1:] == [
        "objects: 3",
        f"{tmp_path}: tables",
        "7 jobs done, 1 failed, in 1 min 1 s",
    ]


@pytest.mark.parametrize("options", [{}, {"verbose": True}, {"printshellcmds": True}])
def test_with_quiet_errors_alone_are_shown_and_jobs_are_counted(options):
    made = handler({}, quiet=[Quietness.ALL], **options)
    made.addFilter(DefaultFilter([Quietness.ALL], False, False, False, False))  # as Snakemake's manager does
    wrong = "the config does not fit its schema:\n  sed: unknown key"
    assert shown(made, record(None, logging.ERROR, wrong)) == wrong  # before there is a run
    job = {"jobid": 1, "rule_name": "meshes", "output": ["m"], "log": []}
    for silent in (
        record("run_info", stats={"meshes": 2, "total": 2}),
        record("job_info", **job),
        record("job_finished", job_id=1),
        record(None, logging.WARNING, "objects: 3"),
        record("error", logging.ERROR, "exit status 1", exception="RuleException"),
    ):
        assert not shown(made, silent)
    assert shown(made, record("job_error", logging.ERROR, **job)) == "failed: meshes m: ended from outside"
    assert (made.done, len(made.failures)) == (1, 1)
    made.stop()
    assert not shown(made, record(None, logging.INFO, "Complete log(s): x"))
    (reached := record(None)).reached = threading.Event()
    made.handle(reached)
    assert reached.reached.is_set()  # else the end of the run would wait for it


def test_a_table_that_was_changed_is_said_at_the_end_in_a_line(tmp_path, monkeypatch, caplog):
    def refuse(folder):
        raise DamagedFile("rejected/meshes/batch-0000.csv is not text; remove it")

    monkeypatch.setattr("palpate.dataset.summary", refuse)
    monkeypatch.setattr(LogHandler, "current", None)
    monkeypatch.setattr(hooks.logger, "propagate", True)
    before = signal.getsignal(signal.SIGINT)
    hooks.finish(str(tmp_path), object_pages=0)
    signal.signal(signal.SIGINT, before)
    assert caplog.messages[0] == "DamagedFile: rejected/meshes/batch-0000.csv is not text; remove it"


def test_a_run_notes_the_commit_of_its_workflow(monkeypatch):
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=Path(hooks.__file__).parent, capture_output=True, text=True)
    if head.returncode:
        assert hooks.commit() == {}
    else:
        assert hooks.commit()["commit"].removesuffix("-dirty") == head.stdout.strip()
    monkeypatch.setenv("PATH", "")
    assert hooks.commit() == {}
