"""A Slurm cluster of one node, on this machine: the smoke run through it ends in the same bytes as without.

    apt-get install slurm-wlm munge; make slurm
    python -m studies.reliability.slurm

It needs root. Its daemons have ports, keys and folders of their own and end with it. In the middle of the run a job is
killed with `scancel`; the run ends with an error, is started again, and continues.
"""

import argparse
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from studies.reliability.small_run import PROJECT, SmallRun, differences, finish, small_run

# One node keeps no accounts. Jobs take seconds: they are looked at soon.
OPTIONS = (
    *("--workflow-profile", str(PROJECT / "profiles/slurm")),
    *("--slurm-no-account", "--slurm-status-command", "squeue"),
    *("--slurm-init-seconds-before-status-checks", "2", "--seconds-between-status-checks", "2"),
)
CONFIG_PLACE = Path("/etc/slurm/slurm.conf")
CONFIG = Path(__file__).with_suffix(".conf").read_text()


@contextmanager
def cluster(folder: Path) -> Iterator[None]:
    """The daemons of a cluster of one node, which all of this machine uses while the block runs."""
    host, sockets = socket.gethostname(), [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    megabytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key, config = folder / "munge.key", folder / "slurm.conf"
    key.write_bytes(secrets.token_bytes(1024))
    key.chmod(0o600)
    config.write_text(CONFIG.format(host=host, folder=folder, ports=ports, cpus=os.cpu_count(), megabytes=megabytes))
    munge = [f"--{name}={folder}/munge.{end}" for name, end in (("socket", "socket"), ("key-file", "key"))]
    munge += [f"--{name}={folder}/munged.{name}" for name in ("pid-file", "log-file", "seed-file")]
    if CONFIG_PLACE.exists():
        raise RuntimeError(f"{CONFIG_PLACE} exists: this machine belongs to a cluster")
    with ExitStack() as stack:
        CONFIG_PLACE.symlink_to(config)  # jobs do not inherit SLURM_CONF
        stack.callback(CONFIG_PLACE.unlink)
        for command in (["munged", "--foreground", "--force", *munge], ["slurmctld", "-D"], ["slurmd", "-D"]):
            with open(folder / f"{command[0]}.out", "w") as output:
                process = subprocess.Popen(command, stdout=output, stderr=output)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            time.sleep(2)
            if process.poll() is not None:
                raise RuntimeError(f"{command[0]} ended: " + (folder / f"{command[0]}.out").read_text()[-2000:])
        yield


def killed_in_the_middle(run: SmallRun, log: Path) -> str:
    """Start a run, kill its grasping job, and wait for its end. Returns the line that says so."""
    process = run.start(*OPTIONS, log=log)
    while not list(run.folder.glob("logs/grasps/*.log")):
        if process.poll() is not None:
            raise RuntimeError("the run ended before its grasps:\n" + log.read_text()[-2000:])
        time.sleep(0.1)
    jobs = subprocess.run(["squeue", "--noheader", "--format=%i %k"], capture_output=True, text=True, check=True)
    grasping = next(line.split()[0] for line in jobs.stdout.splitlines() if "grasps" in line)
    subprocess.run(["scancel", "--signal=KILL", "--full", grasping], check=True)
    try:
        if process.wait(600) == 0:
            raise RuntimeError("the run did not notice that its job was killed")
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGINT)
        raise
    return next(line for line in log.read_text().splitlines() if line.startswith("failed: "))


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        local = small_run(folder, "local")
        start = time.monotonic()
        finish(local, "--cores", "2", log=folder / "local.log")
        print(f"local: {len(local.contents())} files, {time.monotonic() - start:.0f} s", flush=True)
        (folder / "cluster").mkdir()
        with cluster(folder / "cluster"):
            run, log = small_run(folder, "slurm"), folder / "slurm.log"
            print(subprocess.run(["sinfo"], capture_output=True, text=True, check=True).stdout, end="")
            start = time.monotonic()
            print(killed_in_the_middle(run, log).replace(name, "FOLDER"), flush=True)
            finish(run, *OPTIONS, log=log)
            seconds = time.monotonic() - start
        lost = differences(run, local.contents())
        print(f"slurm: {len(run.contents())} files, {seconds:.0f} s; {len(lost)} differ from the local run's")
        print("\n".join(lost))
        sys.exit(bool(lost))


if __name__ == "__main__":
    main()
