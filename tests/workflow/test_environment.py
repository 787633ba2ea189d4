import subprocess
import sys

from tests.workflow.conftest import PROJECT
from workflow.run.environment import warning


def test_another_version_is_named_and_what_is_right_or_missing_is_not(tmp_path):
    """What is installed, as pip itself lists it."""
    listed = subprocess.run([sys.executable, "-m", "pip", "freeze", "--all"], capture_output=True, text=True).stdout
    pins = [line for line in listed.splitlines() if "==" in line]
    numpy = next(line for line in pins if line.startswith("numpy=="))
    requirements = tmp_path / "requirements.txt"
    requirements.write_text("\n".join(["# a comment", *pins, "no-such-package==1.0"]))
    assert warning(requirements) == ""
    requirements.write_text(requirements.read_text().replace(numpy, "numpy==0.9  # of old"))
    others = f"numpy {numpy.partition('==')[2]} (locked: 0.9)"
    assert warning(requirements) == f"this environment is not the locked one: {others}; `make env` builds that"


def test_the_cluster_plugin_asks_for_nothing_that_the_lock_does_not_have():
    """Installed without dependencies: what it wants besides must be among the locked packages."""
    pins = dict(
        line.split("==")
        for name in ("requirements", "slurm")
        for line in (PROJECT / f"envs/{name}.txt").read_text().splitlines()
        if "==" in line
    )
    assert pins["numpy"].startswith("1.") and "snakemake-executor-plugin-slurm" in pins
    assert {"pandas", "pyyaml", "throttler", "snakemake-interface-executor-plugins"} <= set(pins)
    assert "snakemake-executor-plugin-slurm-jobstep" in pins


def test_this_environment_is_the_locked_one():
    assert warning(PROJECT / "envs/requirements.txt") == ""
