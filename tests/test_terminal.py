"""What a run prints: progress with an estimate, failures in a line, unknown targets, and the end."""

import io
import logging

import pytest

from palpate.terminal import (
    INTERRUPTED,
    Errors,
    Estimate,
    Progress,
    duration,
    end_lines,
    excepthook,
    last_line,
    unknown_target,
)


class Clock:
    time = 0.0

    def __call__(self):
        return self.time


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


@pytest.mark.parametrize(("seconds", "said"), [(12.4, "12 s"), (185, "3 min 5 s"), (4800, "1 h 20 min")])
def test_durations_are_as_one_reads_them(seconds, said):
    assert duration(seconds) == said


def test_progress_is_one_line_and_a_failure_is_one_line(tmp_path):
    clock, stream = Clock(), io.StringIO()
    progress = Progress({"meshes": 3}, stream, clock)
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
        assert not progress.filter(page)
    assert progress.filter(record(None, logging.WARNING, "something else"))
    assert progress.line() == "1 of 3 jobs done, 1 failed, 1 min 10 s so far, about 20 s left"
    assert stream.getvalue() == (
        f"failed: meshes meshes/batch-0001: x.zarr: the disk is full: free some space (log: {log})\n"
    )
    progress.stop()
    assert progress.filter(record(None, logging.INFO, "the end"))


def test_what_snakemake_says_again_at_the_end_is_omitted():
    progress = Progress({"meshes": 1}, io.StringIO(), Clock())
    progress.stop()
    for text in (
        "WorkflowError:\nAt least one job did not complete successfully.",
        "Exiting because a job execution failed. Look above for error messages",
        "Elapsed time: 0:00:21.319559",
    ):
        assert not progress.filter(record(None, logging.ERROR, text))
    assert progress.filter(record(None, logging.INFO, "Complete log(s): x"))


def test_an_interrupted_run_says_so_and_nothing_of_its_jobs():
    stream = io.StringIO()
    progress = Progress({"meshes": 1}, stream, Clock())
    progress.interrupt()
    failed = record("job_error", logging.ERROR, jobid=1, rule_name="meshes", output=["m"], log=[])
    assert not progress.filter(failed) and not progress.failures
    assert not progress.filter(record(None, logging.ERROR, "WorkflowError: x", exception="WorkflowError"))
    assert progress.filter(record(None, logging.WARNING, INTERRUPTED))
    assert stream.getvalue() == "stopping the jobs that run\n"


def test_an_interrupt_before_the_run_is_one_line(capsys):
    excepthook(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert capsys.readouterr().err == f"{INTERRUPTED}\n"
    excepthook(ValueError, ValueError("as ever"), None)
    assert "ValueError: as ever" in capsys.readouterr().err


def test_a_job_that_the_system_killed_is_said_to_be(tmp_path):
    progress = Progress({"grasps": 1}, io.StringIO(), Clock())
    progress.filter(record("job_info", jobid=1, rule_name="grasps", output=["g.h5"], log=[]))
    progress.filter(record("error", logging.ERROR, "died with <Signals.SIGKILL: 9>.", exception="RuleException"))
    progress.filter(record("job_error", logging.ERROR, jobid=1, rule_name="grasps", output=["g.h5"], log=[]))
    assert "memory is short" in progress.failures[0].said
    progress.filter(record("job_error", logging.ERROR, jobid=2, rule_name="grasps", output=["h.h5"], log=[]))
    assert progress.failures[1].said == "ended from outside"  # it had no time for a line in its log


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
    held = record("error", logging.ERROR, text, exception=kind)
    assert Errors(lambda path: f"<{path}>").filter(held)
    assert held.msg.startswith(said) and (said == "as it is" or "\n" not in held.msg)


def test_an_unknown_target_without_a_near_one_gets_the_notes_alone():
    assert unknown_target("zzzz", ["dataset", "all"], ["by name: all"]) == "no target zzzz\n  by name: all"


def test_the_last_line_of_a_log(tmp_path):
    (tmp_path / "log").write_bytes(b"one\n\xff two \n\n")
    assert last_line(tmp_path / "log").endswith("two") and last_line(tmp_path / "none") == ""


def test_of_a_job_that_a_cluster_refuses_its_word_is_passed_on(tmp_path):
    stream = io.StringIO()
    progress = Progress({"touch_depth": 2}, stream, Clock())
    message = "SLURM sbatch failed. The error message was 'Invalid generic resource'.\n    sbatch call: ..."
    fields = {"rule_name": "touch_depth", "output": ["best.ckpt"], "log": [str(tmp_path / "touch_depth.log")]}
    progress.filter(record("job_error", logging.ERROR, jobid=1, rule_msg=message, **fields))
    progress.filter(record("job_error", logging.ERROR, jobid=2, rule_msg=None, **fields))
    assert [each.said for each in progress.failures] == [message.splitlines()[0], "ended from outside"]


def test_the_end_names_objects_places_and_time_and_counts_what_failed(tmp_path):
    (tmp_path / "tables").mkdir()
    lines = end_lines(tmp_path, ["objects: 3"], 1, 7, 61)
    assert lines == [
        "objects: 3",
        f"{tmp_path}: tables",
        "7 jobs done, 1 failed, in 1 min 1 s",
    ]
