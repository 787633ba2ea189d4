import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest

import palpate.store
from palpate import seal
from palpate.atomic import atomic_write, sweep
from palpate.sensor import DIGIT
from palpate.store import read, write


def make(path, text, folder):
    if folder:
        path.mkdir()
        path = path / "inner.txt"
    path.write_text(text)


def content(path):
    return (path / "inner.txt" if path.is_dir() else path).read_text()


@pytest.mark.parametrize("folder", [False, True])
@pytest.mark.parametrize("existing", [None, False, True])
def test_appears_at_the_end_and_replaces_what_was_there(tmp_path, folder, existing):
    path = tmp_path / "deep" / "thing.txt"
    if existing is not None:
        path.parent.mkdir()
        make(path, "old", existing)
    with atomic_write(path) as partial:
        assert partial.parent == path.parent and partial.suffix == path.suffix
        make(partial, "new", folder)
        assert not path.exists() if existing is None else content(path) == "old"
    assert path.is_dir() == folder and content(path) == "new"
    assert [entry.name for entry in path.parent.iterdir()] == ["thing.txt"]


@pytest.mark.parametrize("folder", [False, True])
def test_an_error_leaves_what_was_there(tmp_path, folder):
    path = tmp_path / "thing"
    make(path, "old", folder)
    with pytest.raises(ZeroDivisionError), atomic_write(path) as partial:
        make(partial, "new", folder)
        1 / 0  # noqa: B018
    assert content(path) == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["thing"]


def test_writing_nothing_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match="nothing was written"), atomic_write(tmp_path / "thing"):
        pass


@contextmanager
def other_writer(path, folder):
    """Another process that has written `theirs`, and ends its write when it is told a line."""
    code = (
        "import os, sys\nfrom palpate.atomic import atomic_write\n"
        "with atomic_write(sys.argv[1]) as partial:\n"
        "    place = partial\n"
        "    if int(sys.argv[2]): os.mkdir(partial); place = partial / 'inner.txt'\n"
        "    place.write_text('theirs')\n"
        "    print('half', flush=True)\n"
        "    input()\n"
    )
    command = [sys.executable, "-c", code, str(path), str(int(folder))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "half\n"
        yield process


@pytest.mark.parametrize("folder", [False, True])
def test_leftovers_of_a_killed_run_are_removed(tmp_path, folder):
    path = tmp_path / "thing"
    with other_writer(path, folder) as process:
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    assert len(list(tmp_path.iterdir())) == 1
    with atomic_write(path) as partial:
        make(partial, "new", folder)
    assert content(path) == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["thing"]


@pytest.mark.parametrize("folder", [False, True])
def test_two_writers_of_one_path_do_not_disturb_each_other(tmp_path, folder):
    path = tmp_path / "thing.txt"
    with other_writer(path, folder) as process:
        with atomic_write(path) as partial:
            make(partial, "ours", folder)
        assert content(path) == "ours"
        process.communicate("\n")
    assert process.returncode == 0 and content(path) == "theirs"
    assert [entry.name for entry in tmp_path.iterdir()] == ["thing.txt"]


def test_what_killed_processes_left_is_swept_and_nothing_else(tmp_path):
    keep = ["a/thing.txt", "a/partial.txt", "a/.hidden", "a/batch-0000.zarr/.partial-x~1~a-inside"]
    stale = ["a/.partial-elsewhere~7~0f-thing.txt", "a/b/.replaced-here~8~0f-batch-0000/x"]
    for name in keep + stale:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    removed = sweep(tmp_path, re.compile("batch-.*"))
    assert len(removed) == len(stale)
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()) == sorted(keep)


def points(objects):
    names = np.array([f"a-{number}" for number in range(objects)])
    clouds = np.random.default_rng(0).random((objects, 10000, 3), dtype=np.float32)
    return {"object": names, "points": clouds}


ATTRIBUTES = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
WRITE = """
import sys
sys.path.insert(0, sys.argv[1])
import test_atomic, palpate.store
palpate.store.write(sys.argv[2], "surface", test_atomic.points(400), test_atomic.ATTRIBUTES)
"""


def test_a_write_that_is_killed_leaves_no_store_and_the_next_succeeds(tmp_path):
    path = tmp_path / "surface" / "batch-0000.zarr"
    command = [sys.executable, "-c", WRITE, os.path.dirname(__file__), str(path)]
    with subprocess.Popen(command) as process:
        while not list(path.parent.glob(".partial-*/points/zarr.json")):  # in the middle: no points yet
            assert process.poll() is None
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
    assert list(path.parent.glob(".partial-*-batch-0000.zarr")) and not path.exists()
    with pytest.raises(palpate.store.StoreError, match="does not exist"):
        read(path)
    arrays = points(2)
    write(path, "surface", arrays, ATTRIBUTES)
    np.testing.assert_array_equal(read(path)["points"], arrays["points"])
    assert [entry.name for entry in path.parent.iterdir()] == ["batch-0000.zarr"]


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("stop", range(4))
def test_a_file_is_never_beside_the_seal_of_another(tmp_path, monkeypatch, existing, stop):
    """Wherever the process is killed between the renames: a file that is there is as its seal states."""
    path = tmp_path / "thing.csv"
    if existing:
        with atomic_write(path, {}) as partial:
            partial.write_text("old")
    replace, done = os.replace, []

    def killed(source, target):
        if len(done) == stop:
            raise KeyboardInterrupt
        done.append(target)
        replace(source, target)

    monkeypatch.setattr(os, "replace", killed)
    monkeypatch.setattr("palpate.atomic.remove", lambda path: None)  # nothing is tidied up, either
    with suppress(KeyboardInterrupt), atomic_write(path, {}) as partial:
        partial.write_text("new")
    if path.exists():
        assert seal.verify(path)
        assert path.read_text() == ("old" if existing and stop == 0 else "new")


@pytest.mark.parametrize("small_disk", ["size=64k"], indirect=True)
def test_a_full_disk_leaves_the_old_file_with_its_seal(small_disk):
    path = small_disk / "thing.csv"
    with atomic_write(path, {}) as partial:
        partial.write_text("old")
    for size in (2**17, 2**16 - 2 * 4096):  # the file has no room, or its seal
        with pytest.raises(OSError, match="No space left"), atomic_write(path, {}) as partial:
            partial.write_bytes(bytes(size))
        assert seal.verify(path) and path.read_text() == "old"
        assert sorted(os.listdir(small_disk)) == [".thing.csv.seal.json", "thing.csv"]
