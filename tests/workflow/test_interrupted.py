"""Ctrl-C, and SIGTERM, in a run: its jobs end, it says so in a line, and the same command goes on."""

import contextlib
import fcntl
import os
import signal
import subprocess
import time

import psutil
import pytest

from snakemake_logger_plugin_palpate import INTERRUPTED
from tests.workflow.conftest import PROJECT
from workflow.run import lock


@pytest.fixture(scope="module")
def workflow(make_workflow):
    """Its meshes are made by the first of these tests, its surface store by the last."""
    return make_workflow()


@pytest.mark.parametrize("how", ["process", "terminate", "terminal"])
def test_an_interrupted_run_ends_its_jobs_and_says_so(workflow, tmp_path, how):
    """terminal: all of the process group get SIGINT, as from a terminal; else just the main process gets a signal."""
    # Python runs a sitecustomize when it starts: the job hangs before its script does, in the middle of imports.
    (tmp_path / "sitecustomize.py").write_text(
        "import sys, time\nif any('.surface.py' in each for each in sys.orig_argv): time.sleep(600)\n"
    )
    process = subprocess.Popen(
        workflow.command("surface/batch-0000.zarr"),
        cwd=PROJECT,
        env=os.environ | {"PYTHONPATH": f"{tmp_path}:{PROJECT}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    jobs = []
    while not jobs and process.poll() is None:
        time.sleep(0.1)
        with contextlib.suppress(psutil.Error):  # of processes that end meanwhile
            children = psutil.Process(process.pid).children(recursive=True)
            jobs = [each for each in children if ".surface.py" in " ".join(each.cmdline())]
    if how == "terminal":
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT if how == "process" else signal.SIGTERM)
    printed, _ = process.communicate(timeout=120)  # and not after 600 s
    assert jobs and process.returncode != 0
    assert not any(job.is_running() and job.status() != psutil.STATUS_ZOMBIE for job in jobs)
    assert printed.rstrip().endswith("stopping the jobs that run\ninterrupted; the same command goes on"), printed
    for noise in ("Traceback", "KeyboardInterrupt", "failed", "Error"):
        assert noise not in printed, printed
    if how == "terminal":
        result = workflow("surface/batch-0000.zarr")
        assert result.returncode == 0 and (workflow.run / "surface/batch-0000.zarr").exists(), result.stderr


def test_a_run_that_waits_for_jobs_of_a_killed_one_ends_at_sigterm(make_workflow):
    """Snakemake's own handler waits until the jobs that it has started end, and has started none."""
    run = make_workflow()
    run.run.mkdir()
    with open(run.run / lock.JOBS_LOCK, "a+") as file:
        fcntl.flock(file, fcntl.LOCK_SH)  # as a job does
        process = subprocess.Popen(
            run.command("catalogue.csv"), cwd=PROJECT, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        next(line for line in process.stderr if "waiting for jobs of a run that was killed" in line)
        process.terminate()
        _, printed = process.communicate(timeout=10)
    assert process.returncode != 0 and printed == f"{INTERRUPTED}\n"
    assert not (run.run / "catalogue.csv").exists()
