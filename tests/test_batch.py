"""What a stage does with a batch: seeds, rejections, progress in the log."""

import io
import logging
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate import seal, store
from palpate.atomic import atomic_write
from palpate.batch import (
    Rejection,
    UnusableObject,
    each_object,
    generator,
    one_line_error,
    read_rejections,
    write_rejections,
)
from palpate.catalogue import read_catalogue
from palpate.seal import DamagedFile


@given(st.integers(0, 2**32), st.lists(st.text(max_size=5), min_size=1, max_size=3))
def test_a_generator_depends_on_its_seed_and_names_only(seed, names):
    first = generator(seed, *names).random(4)
    np.testing.assert_array_equal(first, generator(seed, *names).random(4))
    for other in (generator(seed + 1, *names), generator(seed, *names, ""), generator(seed, "x", *names)):
        assert not np.array_equal(first, other.random(4))


def test_one_object_that_fails_does_not_cost_the_batch(caplog):
    def half(name: str) -> float:
        if name == "flat":
            raise UnusableObject("has no area")
        return 1 / (len(name) - 3)

    with caplog.at_level(logging.INFO):
        results, rejections = each_object(["long", "flat", "bad", "longer"], half, "halving")
    assert results == {"long": 1.0, "longer": pytest.approx(1 / 3)}
    assert list(results) == ["long", "longer"]
    assert rejections == [
        Rejection("flat", "halving", "has no area"),
        Rejection("bad", "halving", "ZeroDivisionError: division by zero"),
    ]
    assert "Traceback" in caplog.text  # of what was not expected
    assert "halving 4/4: longer" in caplog.text


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("stream", "set_by_run", "shown"),
    [(Terminal, {}, True), (Terminal, {"TQDM_DISABLE": "1"}, False), (io.StringIO, {}, False)],
)
def test_a_bar_is_for_a_terminal_that_the_run_does_not_use(monkeypatch, stream, set_by_run, shown):
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    for name, value in set_by_run.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", stream())
    each_object(["one"], str, "reading")
    assert ("reading: 100%" in sys.stderr.getvalue()) == shown


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), MemoryError(), DamagedFile("cut off")])
def test_what_the_machine_lacks_is_no_fault_of_the_object(error, caplog):
    def stop(name: str) -> None:
        raise error

    with pytest.raises(type(error)):
        each_object(["one"], stop, "writing")
    assert "one was not finished" in caplog.text


reasons = st.text(st.characters(codec="utf-8", exclude_characters="\r\x00"))


@given(st.lists(st.builds(Rejection, st.text("abc-", min_size=1), st.just("meshes"), reasons)))
def test_rejections_survive_their_file(tmp_path_factory, rejections):
    path = tmp_path_factory.mktemp("rejected") / "batch.csv"
    write_rejections(path, rejections)
    assert read_rejections([path, path]) == rejections + rejections


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError(28, "No space left on device", "x.zarr"), "x.zarr: the disk is full: free some space"),
        (
            OSError("Can't write data (file write failed: errno = 28, error message = 'No space left on device')"),
            "full",
        ),
        (
            OSError(30, "Read-only file system", "a/b.csv"),
            "a/b.csv: Read-only file system: give the right to it, or se",
        ),
        (PermissionError(13, "Permission denied", "a/b.csv"), "a/b.csv: Permission denied: give the right to it, or"),
        (MemoryError("Unable to allocate 9 TiB"), "too little memory (Unable to allocate 9 TiB): start again with few"),
        (ValueError("two\nlines"), "ValueError: two lines"),
    ],
)
def test_an_error_is_one_line_with_its_remedy(error, message):
    assert message in one_line_error(error) and "\n" not in one_line_error(error)


OUT_OF_MEMORY = [
    RuntimeError("Failed to apply filter: meshing_decimation_quadric_edge_collapse\nDetails: std::bad_alloc"),
    RuntimeError("System is out of GPU memory"),
    RuntimeError("[enforce fail at alloc_cpu.cpp:117] DefaultCPUAllocator: can't allocate memory: you tried"),
    OSError(12, "Cannot allocate memory"),
]


@pytest.mark.parametrize("error", OUT_OF_MEMORY)
@pytest.mark.parametrize("hidden", [False, True])
def test_lack_of_memory_in_an_engines_words_stops_the_batch(error, hidden):
    def grasp(name: str) -> None:
        if hidden:
            raise UnusableObject("can't be read") from error
        raise error

    with pytest.raises((MemoryError, OSError)) as raised:
        each_object(["mug"], grasp, "grasps")
    assert one_line_error(raised.value).startswith("too little memory (")
    assert "fewer --cores, or free some memory" in one_line_error(raised.value)


# An engine's failure that names no cause, under a limit (MB beyond what is in use) that may be lifted or not.
IN_DOUBT = """
import os, resource, sys
from palpate.batch import each_object
limit = int(open("/proc/self/statm").read().split()[0]) * os.sysconf("SC_PAGE_SIZE") + (64 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit if sys.argv[1] == "hard" else resource.RLIM_INFINITY))
tries = []
def engine(name):
    tries.append(name)
    if name == "broken" or resource.getrlimit(resource.RLIMIT_AS)[0] == limit:
        raise RuntimeError("Caught an unknown exception!")
    return "made"
results, rejections = each_object(["broken", "good"], engine, "grasps")
print(results, [rejection.object for rejection in rejections], tries)
"""


def test_a_failure_in_doubt_is_tried_again_with_the_limit_lifted():
    def run(limit):
        return subprocess.run([sys.executable, "-c", IN_DOUBT, limit], capture_output=True, text=True, check=False)

    assert run("soft").stdout == "{'good': 'made'} ['broken'] ['broken', 'broken', 'good']\n"
    stopped = run("hard")
    assert stopped.returncode and "MemoryError: broken: RuntimeError: Caught an unknown exc" in stopped.stderr
    assert "less than 2 GiB can be had" in stopped.stderr


# Real stages with so little memory that engines fail in their own ways: a library crashes, or states no cause.
STAGES = """
import os, resource, sys
from pathlib import Path
import trimesh
from palpate import grasp, hand, mesh
from palpate.batch import each_object, generator
stage, folder, spare = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
ball = trimesh.creation.icosphere(subdivisions=5, radius=0.25)
ball.export(folder / "ball.obj")
import palpate.mesh.build
robot, points = hand.allegro(), ball.sample(1000, seed=0) + mesh.OBJECT_POSITION
limit = int(open("/proc/self/statm").read().split()[0]) * os.sysconf("SC_PAGE_SIZE") + (spare << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
settings = {"per_object": 1, "attempts": 1, "max_attempts": 9, "timestep": 0.004, "max_penetration": 0.001}
def make(name):
    if stage == "meshes":
        return mesh.prepare(folder / "ball.obj", folder / "ball")
    return grasp.grasp_object(ball, ball, points, robot, generator(0, name), thumb_share=0.15, **settings)
results, rejections = each_object(["ball"], make, stage)
print("made" if results else rejections)
"""


@pytest.mark.parametrize(("stage", "spare"), [("meshes", 0), ("meshes", 16), ("meshes", 32), ("grasps", 64)])
def test_no_stage_rejects_an_object_for_lack_of_memory(tmp_path, stage, spare):
    command = [sys.executable, "-c", STAGES, stage, str(tmp_path), str(spare)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "Rejection" not in done.stdout
    assert done.stdout == "made\n" or done.returncode < 0 or "MemoryError" in done.stderr, done.stderr[-2000:]


def test_the_disk_that_is_full_is_named_and_stops_the_batch(tmp_path):
    """HDF5 names the file in its own words, whatever kind of error it raises."""
    path = tmp_path / "x.h5"
    words = f"Can't write (file write failed: time = Mon, filename = '{path}', errno = 28, error message = 'No space')"

    def write(name: str) -> None:
        raise RuntimeError(words)

    with pytest.raises(OSError) as raised:
        each_object(["mug"], write, "grasps")
    assert one_line_error(raised.value).startswith(f"{path}: the disk is full: free some space")


def as_nobody(folder, read):
    """What reading raises, as a line, for a user who may not read the folder's files."""
    receiver, sender = os.pipe()
    child = os.fork()
    if not child:
        try:
            if os.geteuid() == 0:
                os.setuid(65534)
            read()
            message = "nothing"
        except BaseException as error:
            message = one_line_error(error)
        os.write(sender, message.encode())
        os._exit(0)
    os.waitpid(child, 0)
    return os.read(receiver, 10_000).decode()


@pytest.fixture
def open_folder():
    """A folder that every user may look into."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def test_a_file_that_may_not_be_read_is_not_damaged(open_folder):
    folder = open_folder
    table, record = folder / "catalogue.csv", folder / "meshes/seal.json"
    table.write_text("object,class,split,batch\na,b,train,batch-0000\n")
    record.parent.mkdir()
    record.write_text("{}")
    zarr, hdf5 = folder / "rings/batch-0000.zarr", folder / "grasps/batch-0000.h5"
    ring = {"object": np.array(["a"]), "ring_depth": np.zeros((1, 1, 4, 2, 2), np.float32)}
    store.write(zarr, "rings", ring, {"seed": 0, "made_from": {}})
    hdf5.parent.mkdir()
    hdf5.write_bytes(b"x")
    opened = store.open(zarr)
    shard = next(path for path in (zarr / "object/c").rglob("*") if path.is_file())
    reads = {
        table: lambda: read_catalogue(table),
        record: lambda: seal.read(record.parent),
        zarr / "zarr.json": lambda: store.open(zarr),
        shard: lambda: opened.get("object"),
        hdf5: lambda: store.open(hdf5),
    }
    for path, read in reads.items():
        path.chmod(0)
        message = as_nobody(folder, read)
        assert "Permission denied: give the right to it" in message, (path, message)
        assert "damaged" not in message and "remove it" not in message
        path.chmod(0o644)


@pytest.mark.parametrize("small_disk", ["nr_inodes=4,size=1m"], indirect=True)
def test_a_folder_that_takes_no_more_files_is_named(small_disk):
    """Inodes are used up, and there is room."""
    with pytest.raises(OSError) as raised:
        for number in range(9):
            with atomic_write(small_disk / f"{number}.txt") as partial:
                partial.write_text("x")
    message = one_line_error(raised.value)
    full = "the disk is full: it takes no more files (inodes): remove some and start"
    assert str(small_disk) in message and full in message, message
    assert not [name for name in os.listdir(small_disk) if name.startswith(".partial")]
