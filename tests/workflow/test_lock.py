"""A run's folder is one run's; the lock ends with its process, and with the last of its jobs."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import pytest

from tests.workflow.conftest import PROJECT
from workflow.run import lock

HOLD = "import sys; from workflow.run import lock; lock.hold(sys.argv[1], print); print('held', flush=True); input()"
SHARE = "import sys; from workflow.run import lock; lock.share(sys.argv[1]); print('shared', flush=True); input()"


@contextmanager
def process(code, folder, **options):
    """A process that has done what the code does up to its first line of output, and waits."""
    command = [sys.executable, "-c", code, str(folder)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=PROJECT, **options
    ) as started:
        try:
            started.line = started.stdout.readline()
            yield started
        finally:
            started.kill()


@pytest.fixture(autouse=True)
def held(monkeypatch):
    """What this process holds is given back at the end of a test."""
    files = []
    monkeypatch.setattr(lock, "_held", files)
    yield
    for file in files:
        file.close()


def test_a_second_run_is_told_which_process_on_which_machine(tmp_path):
    with process(HOLD, tmp_path) as first:
        assert first.line == "held\n"
        with pytest.raises(lock.FolderInUse) as error:
            lock.hold(tmp_path, print)
        for said in (str(tmp_path), f"process {first.pid} on {socket.gethostname()}", "run=<another name>"):
            assert said in str(error.value)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, None])
def test_a_lock_ends_with_its_process_however_it_ends(tmp_path, end):
    with process(HOLD, tmp_path) as first:
        first.send_signal(end) if end else first.communicate("\n")
        first.wait()
        lock.hold(tmp_path, print)
    assert f"process {os.getpid()} on" in (tmp_path / lock.LOCK).read_text()


def test_a_child_that_outlives_its_run_does_not_keep_the_lock(tmp_path):
    code = HOLD.replace("print('held'", "import subprocess; subprocess.Popen(['sleep', '60']); print('held'")
    with process(code, tmp_path, start_new_session=True) as first:
        first.kill()
        first.wait()
        lock.hold(tmp_path, print)
        os.killpg(first.pid, signal.SIGKILL)


def test_a_run_waits_for_the_jobs_of_a_killed_one(tmp_path):
    with process(SHARE, tmp_path) as job, process(HOLD, tmp_path) as run:
        assert job.line == "shared\n"
        assert "waiting for jobs of a run that was killed" in run.line
        assert f"process {job.pid} on {socket.gethostname()}" in run.line
        job.communicate("\n")
        assert run.stdout.readline() == "held\n"
    lock.hold(tmp_path, print)
    assert (tmp_path / lock.JOBS_LOCK).read_text() == ""


def test_jobs_share_and_do_not_keep_each_other_out(tmp_path):
    with process(HOLD, tmp_path) as run, process(SHARE, tmp_path) as one, process(SHARE, tmp_path) as other:
        assert (run.line, one.line, other.line) == ("held\n", "shared\n", "shared\n")


def test_a_file_system_without_locks_is_said(tmp_path, monkeypatch):
    def unsupported(file, operation):
        raise OSError(lock.UNSUPPORTED[0], "No locks available")

    monkeypatch.setattr(lock.fcntl, "flock", unsupported)
    said = []
    lock.hold(tmp_path, said.append)
    lock.share(tmp_path)
    assert len(said) == 1 and "has no locks" in said[0]
