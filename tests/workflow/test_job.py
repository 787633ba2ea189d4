"""The log of a job: lines, prints of engines, and the error that it ended with."""

import subprocess
import sys

from tests.workflow.conftest import PROJECT


def test_a_job_log_holds_lines_prints_of_engines_and_the_traceback(tmp_path):
    code = (
        "import logging, os, sys; from workflow.run.job import log_to; log_to(sys.argv[1]);"
        "logging.info('a line'); os.system('echo an engine'); raise ValueError('the end')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "log")], capture_output=True, text=True, cwd=PROJECT
    )
    log = (tmp_path / "log").read_text()
    assert done.returncode == 1
    assert "ValueError: the end" in done.stderr and done.stdout == ""
    assert "INFO a line" in log and "an engine" in log and "ValueError: the end" in log
    assert "Traceback" in log and "Traceback" not in done.stderr
    assert log.splitlines()[-1] == "ValueError: the end"


def test_a_job_whose_log_is_on_the_full_disk_says_so_on_the_terminal():
    script = "import os; os.environ['TQDM_DISABLE'] = '1'; from workflow.run.job import log_to; log_to('/dev/full');"
    done = subprocess.run(
        [sys.executable, "-c", script + "raise OSError(28, 'No space left on device', 'x.zarr')"],
        capture_output=True,
        text=True,
        check=False,
        cwd=PROJECT,
    )
    assert done.returncode
    assert "x.zarr: the disk is full: free some space" in done.stderr
