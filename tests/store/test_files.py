import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import hypothesis.extra.numpy as npst
import numpy as np
import pytest
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import palpate.store
from palpate import seal
from palpate.sensor import DIGIT
from palpate.store import CONTRACT, StoreError, join, read, write

ATTRIBUTES = {"made_from": {}, "seed": 3, "sensor": DIGIT.description()}
SIZES = {"n": 5, "m": 7, "s": 4, "j": 3, "l": 2, "r": 4, "c": 6, "rc": 24, "k": 2, "p": 6, "b": 3, "v": 2, "q": 3}
SIZES |= {"w": 5, "f": 3, "h": 2, "a": 3, "i": 3, "u": 2, "t": 2, "e": 3}
STAGES = tuple(CONTRACT)


def arrays_of(stage, objects, grasps=2, rng=None, **sizes):
    """Random arrays of the contract's shapes and types, with few pixels."""
    rng = rng or np.random.default_rng(0)
    sizes = SIZES | {"o": objects, "g": grasps} | sizes
    arrays = {}
    for name, spec in CONTRACT[stage].arrays.items():
        shape = [axis if isinstance(axis, int) else sizes[axis] for axis in spec.shape]
        arrays[name] = rng.integers(0, 2 if spec.dtype == "bool" else 100, shape).astype(
            "U8" if spec.dtype == "string" else spec.dtype
        )
    arrays["object"] = np.array([f"bottle-{number:04d}" for number in range(objects)], dtype=str)
    if stage == "grasps":
        arrays["hand/joint_range"] = rng.random((3, 2))
        arrays["hand/link_names"] = np.array([b"palm", b"index_1"])
    return arrays


def path_of(folder, stage):
    return folder / CONTRACT[stage].path("batch-0000")


def assert_same(stored, expected):
    assert set(stored) == set(expected)
    for name, array in expected.items():
        text = array.dtype.kind in "SU"
        np.testing.assert_array_equal(stored[name], array.astype(str) if text else array, err_msg=name)
        assert text or stored[name].dtype == array.dtype
        assert stored[name].shape == array.shape


def digest(path):
    """SHA-256 of a file, or of all files of a folder with their names."""
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    lines = [f"{file.relative_to(path)} {hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@pytest.mark.parametrize("objects", [0, 1, 3])
@pytest.mark.parametrize("stage", STAGES)
def test_what_is_written_is_read(tmp_path, stage, objects):
    arrays = arrays_of(stage, objects)
    write(path_of(tmp_path, stage), stage, arrays, ATTRIBUTES)
    assert_same(read(path_of(tmp_path, stage)), arrays)
    assert_same(read(path_of(tmp_path, stage), "object"), {"object": arrays["object"]})


@st.composite
def contents(draw):
    """A stage, and arrays of the contract with whatever their types can hold."""
    stage = draw(st.sampled_from(STAGES))
    objects = draw(st.integers(0, 2))
    sizes = {"o": objects, "n": draw(st.integers(0, 3)), **{axis: draw(st.integers(1, 3)) for axis in "gskpv"}}
    sizes |= {
        "m": 2,
        "j": 2,
        "l": 1,
        "r": 2,
        "c": 3,
        "rc": 6,
        "b": 4,
        "q": 2,
        "w": 2,
        "f": 2,
        "h": 1,
        "a": 2,
        "i": 1,
        "u": 1,
        "t": 2,
        "e": 2,
    }
    names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=5)
    arrays = {}
    for name, spec in CONTRACT[stage].arrays.items():
        shape = tuple(axis if isinstance(axis, int) else sizes[axis] for axis in spec.shape)
        if spec.dtype == "string":
            strings = draw(st.lists(names, min_size=shape[0], max_size=shape[0]))
            arrays[name] = np.array(strings, dtype=str).reshape(shape)
        else:
            arrays[name] = draw(npst.arrays(spec.dtype, shape))
    return stage, arrays


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(contents())
def test_any_contents_survive(tmp_path_factory, drawn):
    stage, arrays = drawn
    path = path_of(tmp_path_factory.mktemp("any"), stage)
    write(path, stage, arrays, ATTRIBUTES)
    assert_same(read(path), arrays)


@pytest.mark.parametrize("stage", STAGES)
def test_attributes_say_what_made_the_store_and_no_time(tmp_path, stage):
    write(path_of(tmp_path, stage), stage, arrays_of(stage, 1), ATTRIBUTES | {"samples": 16, "hand": None})
    attributes = palpate.store.open(path_of(tmp_path, stage)).attributes
    assert set(attributes) == {*palpate.store.CONTRACT[stage].all_attributes, *ATTRIBUTES, "samples", "hand"}
    assert attributes["schema_version"] == palpate.store.SCHEMA_VERSION
    assert (attributes["seed"], attributes["made_from"]) == (3, {})
    assert (attributes["samples"], attributes["hand"]) == (16, None)
    engines = {"grasps": "mujoco", "vision": "bpy", "views": "bpy"}
    engines |= {"charts": "torch", "templates": "torch"}
    engines |= {"frames": "mujoco", "frame_images": "bpy", "hold": "mujoco"}
    engine = engines.get(stage, "embreex")
    library = "h5py" if stage == "grasps" else "zarr"
    assert {"palpate", "numpy", library, engine} <= set(attributes["versions"])
    assert attributes["units"]["length"] == "metre" and "0.6" in attributes["frames"]["world"]


OTHER_PROCESS = """
import sys
sys.path.insert(0, sys.argv[1])
import pathlib, test_files, palpate.store
for stage in test_files.STAGES:
    shuffled = dict(sorted(test_files.arrays_of(stage, 3).items(), reverse=True))
    path = test_files.path_of(pathlib.Path(sys.argv[2]), stage)
    palpate.store.write(path, stage, shuffled, test_files.ATTRIBUTES)
"""


def test_the_same_arrays_give_the_same_bytes(tmp_path):
    for place in ("here", "again"):
        for stage in STAGES:
            write(path_of(tmp_path / place, stage), stage, arrays_of(stage, 3), ATTRIBUTES)
    threads = os.environ | {"ZARR_THREADING__MAX_WORKERS": "4", "PYTHONHASHSEED": "7"}
    command = [sys.executable, "-c", OTHER_PROCESS, str(Path(__file__).parent), str(tmp_path / "there")]
    subprocess.run(command, check=True, env=threads)
    for stage in STAGES:
        digests = {digest(path_of(tmp_path / place, stage)) for place in ("here", "again", "there")}
        assert len(digests) == 1, stage


def test_a_store_is_few_files_however_many_objects(tmp_path):
    for stage in ("surface", "touch", "vision"):
        counts = set()
        for objects in (2, 7):
            path = path_of(tmp_path, stage)
            write(path, stage, arrays_of(stage, objects), ATTRIBUTES)
            counts.add(sum(file.is_file() for file in path.rglob("*")))
        # The group's metadata and seal, and for each array its metadata and one shard.
        assert counts == {2 + 2 * len(CONTRACT[stage].arrays)}


def stored_chunks(shard: Path, chunks: int) -> np.ndarray:
    """Which chunks of a shard are there: its index (Zarr's sharding codec) is at the end, with a checksum."""
    index = np.frombuffer(shard.read_bytes()[-16 * chunks - 4 : -4], dtype="<u8").reshape(chunks, 2)
    return index[:, 0] != 2**64 - 1


def test_sensors_that_touched_nothing_are_not_written(tmp_path):
    arrays = arrays_of("touch", 2)
    rng = np.random.default_rng(1)
    arrays["success"][:] = rng.random((2, 2, 4)) < 0.5
    for name, fill in (("depth", np.inf), ("reading", 0), ("points", 0)):
        arrays[name] = np.maximum(arrays[name], 1)
        arrays[name][~arrays["success"]] = fill
    path = path_of(tmp_path, "touch")
    write(path, "touch", arrays, ATTRIBUTES)
    for name in ("depth", "reading", "points"):
        (shard,) = (file for file in (path / name).rglob("*") if file.is_file() and file.name != "zarr.json")
        np.testing.assert_array_equal(stored_chunks(shard, 16).reshape(2, 2, 4), arrays["success"])
    assert_same(read(path), arrays)


def test_a_record_is_a_chunk_and_a_batch_a_shard(tmp_path):
    write(path_of(tmp_path, "touch"), "touch", arrays_of("touch", 3), ATTRIBUTES)
    group = zarr.open_group(path_of(tmp_path, "touch"), mode="r")
    assert group.metadata.zarr_format == 3
    assert group["reading"].chunks == (1, 1, 1, 4, 6, 3)
    assert group["reading"].shards == (3, 2, 4, 4, 6, 3)


# An array and what replaces it, and the error.
WRONG = {
    "missing": ("points", None, r"missing: \['points'\], unknown: \[\]"),
    "unknown": ("colour", lambda _: np.zeros(3), r"unknown: \['colour'\]"),
    "group": ("hand/x", lambda _: np.zeros(3), r"unknown: \['hand/x'\]"),
    "type": ("depth", lambda depth: depth.astype("f8"), "'depth' must be float32.*float64"),
    "axes": ("success", lambda success: success[0], r"'success': shape \(o, g, s\) expected"),
    "sensors": ("success", lambda success: success[:, :, :3], "s = 4, but 'success' has s = 3"),
    "grasps": ("depth", lambda depth: depth[:, 1:], "'depth' .* g = 1, but 'success' has g = 2"),
    "columns": ("depth", lambda depth: depth[..., 1:], "'reading' .* c = 6, but 'depth' has c = 5"),
    "pixels": ("points", lambda points: points[..., 1:, :], "'points': 23 rows, but .* 4 x 6 pixels"),
    "names": ("object", lambda _: np.array([1, 2]), "'object' must be string, but it is int64"),
    "objects": ("object", lambda _: np.array(["a", None]), "'object' must hold strings"),
    "whole": ("object", lambda names: names[[0, 0, 0]], "'success' .* o = 2, but 'object' has o = 3"),
}


@pytest.mark.parametrize("name, change, message", WRONG.values(), ids=WRONG.keys())
def test_arrays_against_the_contract_are_refused_and_named(tmp_path, name, change, message):
    arrays = arrays_of("touch", 2)
    array = arrays.pop(name, None)
    arrays |= {name: change(array)} if change else {}
    with pytest.raises(StoreError, match=message) as error:
        write(path_of(tmp_path, "touch"), "touch", arrays, ATTRIBUTES)
    assert "batch-0000.zarr" in str(error.value)
    assert not list(tmp_path.rglob("*.zarr"))


def test_the_suffix_and_the_attributes_are_checked(tmp_path):
    with pytest.raises(StoreError, match="ends in .h5"):
        write(tmp_path / "a.zarr", "grasps", arrays_of("grasps", 1), ATTRIBUTES)
    with pytest.raises(StoreError, match=r"attributes \['seed'\]"):
        write(tmp_path / "a.h5", "grasps", arrays_of("grasps", 1), {"made_from": {}})


def test_a_run_of_an_earlier_version_is_refused_with_the_command_that_builds_it_again(tmp_path):
    (tmp_path / "rods").mkdir()
    (tmp_path / "rods/config.yaml").touch()
    configs = {"old": f"<the config of the run in {tmp_path}/old>", "rods": f"{tmp_path}/rods/config.yaml"}
    for run, config in configs.items():
        path = path_of(tmp_path / run, "touch")
        write(path, "touch", arrays_of("touch", 1), ATTRIBUTES)
        zarr.open_group(path).attrs["schema_version"] = 1
        command = f"snakemake dataset touch/batch-0000.zarr --cores 2 --configfile {config} --forceall"
        with pytest.raises(StoreError, match=f"{path} has schema version 1, but .* version 7; .* {command}$"):
            palpate.store.open(path)


def test_missing_stores_and_arrays_are_named(tmp_path):
    path = path_of(tmp_path, "touch")
    with pytest.raises(StoreError, match="does not exist; build it with: snakemake touch/batch-0000.zarr"):
        palpate.store.open(path)
    write(path, "touch", arrays_of("touch", 1), ATTRIBUTES)
    with pytest.raises(StoreError, match="has no array 'colour'"):
        palpate.store.open(path).get("colour")


def files_of(path: Path) -> list[Path]:
    """All files of a store."""
    return [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())


def read_all(path: Path) -> dict[str, np.ndarray]:
    """Everything that a store holds, its attributes too."""
    return {"attributes": np.array(json.dumps(palpate.store.open(path).attributes, sort_keys=True))} | read(path)


def refused(path: Path, match: str) -> None:
    with pytest.raises(StoreError, match=match) as error:
        read_all(path)
    assert str(path) in str(error.value) and "snakemake" in str(error.value)


@pytest.mark.parametrize("stage", STAGES)
def test_every_file_that_is_lost_emptied_or_cut_off_is_an_error_not_fill_values(tmp_path, stage):
    path = path_of(tmp_path, stage)
    write(path, stage, arrays_of(stage, 2), ATTRIBUTES)
    for file in files_of(path):
        content = file.read_bytes()
        for kept in (0, len(content) - 1):
            file.write_bytes(content[:kept])
            refused(path, "damaged|can't be read|schema version")
        file.unlink()
        refused(path, "is missing|can't be read|does not exist|has no seal")
        file.write_bytes(content)
    read_all(path)


def test_values_that_go_while_a_store_is_open_are_an_error_at_the_next_read(tmp_path):
    path = path_of(tmp_path, "touch")
    write(path, "touch", arrays_of("touch", 2), ATTRIBUTES)
    store = palpate.store.open(path)
    store.get("depth", 0)
    shutil.rmtree(path / "depth/c")
    for read_again in (
        lambda: store.get("depth", 0),
        lambda: store.get("depth", np.array([0])),
        lambda: store.get("depth"),
    ):
        with pytest.raises(StoreError, match="depth/c/0.* is missing"):
            read_again()


@pytest.mark.parametrize("stage", ["surface", "touch", "grasps"])
def test_no_altered_byte_of_any_file_changes_what_is_read_without_an_error(tmp_path, stage):
    path = path_of(tmp_path, stage)
    write(path, stage, arrays_of(stage, 2), ATTRIBUTES)
    expected, rng = read_all(path), np.random.default_rng(0)
    for file in files_of(path):
        content = file.read_bytes()
        for place in rng.choice(len(content), min(len(content), 3), replace=False):
            altered = bytearray(content)
            altered[place] ^= 1 << rng.integers(8)
            file.write_bytes(altered)
            try:
                found = read_all(path)
            except StoreError as error:
                assert str(path) in str(error) and f"snakemake {stage}/" in str(error)
                continue
            finally:
                file.write_bytes(content)
            assert found.keys() == expected.keys()  # such as a byte that no reader looks at
            for name, values in found.items():
                np.testing.assert_array_equal(values, expected[name], err_msg=f"{file} byte {place}")


def test_a_block_of_zeros_is_an_error(tmp_path):
    # What a power cut leaves of a file whose blocks were not written. Fletcher-32 of zeros is zero.
    path = path_of(tmp_path, "grasps")
    write(path, "grasps", arrays_of("grasps", 3), ATTRIBUTES)
    content = path.read_bytes()
    for start in range(0, len(content), 4096):
        zeros = bytes(min(4096, len(content) - start))
        if content[start : start + 4096] != zeros:
            path.write_bytes(content[:start] + zeros + content[start + 4096 :])
            refused(path, "damaged|can't be read|schema version")


def test_a_file_of_the_same_size_from_another_store_is_found_by_verify(tmp_path):
    path, other = path_of(tmp_path / "a", "touch"), path_of(tmp_path / "b", "touch")
    arrays = arrays_of("touch", 2)
    write(path, "touch", arrays, ATTRIBUTES)
    write(other, "touch", arrays | {"success": ~arrays["success"]}, ATTRIBUTES)
    seal.verify(path)
    assert palpate.store.open(path).seal.digest != palpate.store.open(other).seal.digest
    shutil.rmtree(path / "success")
    shutil.copytree(other / "success", path / "success")
    with pytest.raises(seal.DamagedFile, match=f"{path} is damaged: success/c/0/0/0 has changed since it was written"):
        seal.verify(path)


def test_chunks_of_fill_values_stay_left_out_and_a_file_in_their_place_is_an_error(tmp_path):
    path = path_of(tmp_path, "touch")
    arrays = arrays_of("touch", 2)
    arrays["reading"][:] = 0
    write(path, "touch", arrays, ATTRIBUTES)
    assert not (path / "reading/c").exists()
    assert not read(path, "reading")["reading"].any()
    shard = path / "reading/c/0/0/0/0/0/0"
    shard.parent.mkdir(parents=True)
    shutil.copy(path / "depth/c/0/0/0/0/0", shard)
    with pytest.raises(StoreError, match="reading/c/0.* was not written with it"):
        read(path, "reading")


INDICES = (..., 0, -1, np.int64(2), (1, 1), (1, -1), (slice(1, 3),), (slice(None, None, 2), 0), (2, slice(None)))
INDICES += ((1, 0, ...), (..., 0), [2, 0], ([0, 2], 1), (slice(0, 0),), (np.array([True, False, True]),), (1, 0, 0))


@pytest.mark.parametrize("objects", [1, 3])
@pytest.mark.parametrize("stage", STAGES)
def test_any_index_gives_what_zarr_and_hdf5_give(tmp_path, stage, objects):
    arrays = arrays_of(stage, objects, rng=np.random.default_rng(5))
    for name, spec in CONTRACT[stage].arrays.items():
        if spec.record:  # some records are not written
            arrays[name][0, ..., :1] = arrays[name][-1, 1:] = spec.fill
    path = path_of(tmp_path, stage)
    write(path, stage, arrays, ATTRIBUTES)
    store = palpate.store.open(path)
    whole = h5py.File(path) if path.suffix == ".h5" else zarr.open_group(path)
    for name, spec in CONTRACT[stage].arrays.items():
        if not spec.of_objects or spec.dtype == "string":
            continue
        slowly = whole[name][...]
        for index in INDICES:
            try:
                expected = slowly[index]
            except IndexError:
                with pytest.raises(IndexError):
                    store.get(name, index)
                continue
            found = store.get(name, index)
            np.testing.assert_array_equal(found, expected, err_msg=f"{name} {index}")
            assert (found.dtype, found.shape) == (slowly.dtype, np.shape(expected))
            assert found.flags.writeable  # the caller's own


def test_an_hdf5_file_that_another_replaced_is_an_error_until_it_is_opened_again(tmp_path):
    path = path_of(tmp_path, "grasps")
    arrays = arrays_of("grasps", 2)
    write(path, "grasps", arrays, ATTRIBUTES)
    store = palpate.store.open(path)
    store.get("attempts")
    write(path, "grasps", arrays | {"attempts": arrays["attempts"] + 1}, ATTRIBUTES)
    for name in ("attempts", "palm_pose", "hand/joint_range"):
        with pytest.raises(StoreError, match=f"{path} has changed since it was opened; open the dataset again"):
            store.get(name)
    np.testing.assert_array_equal(palpate.store.open(path).get("attempts"), arrays["attempts"] + 1)
    path.unlink()
    with pytest.raises(StoreError, match="can't be read .*snakemake grasps/batch-0000.h5"):
        store.get("attempts")


def test_a_file_that_goes_between_the_look_at_it_and_its_reading_is_an_error(tmp_path, monkeypatch):
    path = path_of(tmp_path, "touch")
    write(path, "touch", arrays_of("touch", 2), ATTRIBUTES)
    store = palpate.store.open(path)
    store.get("depth", 0)
    shutil.rmtree(path / "depth/c")
    monkeypatch.setattr("palpate.seal.Seal.require", lambda *_, **__: None)  # it was still there
    for read_again in (
        lambda: store.get("depth", (0, 1)),
        lambda: store.get("depth", np.array([0])),
        lambda: store["depth"],
    ):
        with pytest.raises(StoreError, match="can't be read .*No such file"):
            read_again()


def test_an_index_out_of_range_is_not_blamed_on_the_file(tmp_path):
    for stage, array in (("touch", "depth"), ("grasps", "palm_pose")):
        write(path_of(tmp_path, stage), stage, arrays_of(stage, 1), ATTRIBUTES)
        with pytest.raises(IndexError):
            palpate.store.open(path_of(tmp_path, stage)).get(array, 5)


@pytest.mark.parametrize("stage", STAGES)
def test_a_batch_without_objects_joins_and_is_written(tmp_path, stage):
    arrays = join(stage, {})
    if stage in ("touch", "press"):
        arrays["empty_reading"] = np.zeros((4, 4, 3), np.uint8)
    write(path_of(tmp_path, stage), stage, arrays, ATTRIBUTES)
    assert read(path_of(tmp_path, stage))["object"].shape == (0,)


def test_one_thread_a_process_unless_the_user_says_otherwise():
    code = "from palpate.store.zarr_files import load_zarr; print(load_zarr().config.get('threading.max_workers'))"
    for threads, expected in ((None, "1"), ("3", "3")):
        environment = {key: value for key, value in os.environ.items() if not key.startswith("ZARR_")}
        environment |= {"ZARR_THREADING__MAX_WORKERS": threads} if threads else {}
        output = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
        assert output.stdout.strip() == expected, output.stderr


def test_optional_arrays_may_be_missing_and_others_may_not(tmp_path):
    path, arrays = path_of(tmp_path, "vision"), arrays_of("vision", 2)
    names = ("object", "unoccluded", "occluded", "unoccluded_mask", "intrinsics", "extrinsics")
    kept = {name: arrays[name] for name in names}
    write(path, "vision", kept, ATTRIBUTES)
    assert_same(read(path), kept)
    with pytest.raises(StoreError, match="no array 'occluded_depth'"):
        read(path, "occluded_depth")
    del kept["occluded"]
    with pytest.raises(StoreError, match=r"missing: \['occluded'\]"):
        write(path, "vision", kept, ATTRIBUTES)


def test_arrays_that_no_object_has_are_left_out_if_they_are_optional():
    record = {"unoccluded": np.zeros((1, 2, 2, 3)), "occluded": np.zeros((3, 1, 2, 2, 3))}
    record |= {"intrinsics": np.eye(3)[None], "extrinsics": np.eye(3, 4)[None]}
    assert set(join("vision", {"a": record})) == {"object", *record}
    assert "unoccluded_mask" in join("vision", {})
    masked = record | {"unoccluded_mask": np.zeros((1, 2, 2))}
    with pytest.raises(KeyError, match="unoccluded_mask"):
        join("vision", {"a": masked, "b": record})
    with pytest.raises(KeyError, match="occluded"):
        join("vision", {"a": {"unoccluded": np.zeros((1, 2, 2, 3))}})


def test_another_schema_version_is_refused(tmp_path):
    path = path_of(tmp_path, "grasps")
    write(path, "grasps", arrays_of("grasps", 1), ATTRIBUTES)
    with h5py.File(path, "a") as file:
        file.attrs["schema_version"] = "99"
    seal.write(path, seal.read(path).made_from)
    with pytest.raises(StoreError, match=r"batch-0000.* has schema version 99, but .* version 7"):
        palpate.store.open(path)


@pytest.mark.parametrize("array", ["depth", "success", "object"])
def test_an_array_whose_values_are_gone_is_named_when_the_store_is_opened(tmp_path, array):
    path = path_of(tmp_path, "touch")
    write(path, "touch", arrays_of("touch", 2), ATTRIBUTES)
    shutil.rmtree(path / array / "c")
    with pytest.raises(StoreError, match=f"{path} is damaged: {array}/c/0.* is missing; .*snakemake touch/batch-0000"):
        palpate.store.open(path)


@pytest.mark.parametrize("stage", STAGES)
def test_rows_are_those_of_the_array_in_the_order_given(tmp_path, stage):
    arrays = arrays_of(stage, 5, rng=np.random.default_rng(3))
    for name, spec in CONTRACT[stage].arrays.items():
        if spec.record:  # some records are not written, and of the last row none
            arrays[name][1::3, ..., :1] = arrays[name][4] = spec.fill
            arrays[name][0, 0] = spec.fill
    write(path_of(tmp_path, stage), stage, arrays, ATTRIBUTES)
    store = palpate.store.open(path_of(tmp_path, stage))
    for name, spec in CONTRACT[stage].arrays.items():
        if spec.of_objects:
            for rows in ([0, 1, 2, 3, 4], [4, 1, 1], [], [3]):
                found = store.get(name, np.array(rows, int))
                np.testing.assert_array_equal(found, arrays[name][rows], err_msg=name)
                assert found.dtype == arrays[name].dtype or name == "object"
                if arrays[name].ndim > 1:
                    np.testing.assert_array_equal(
                        store.get(name, (np.array(rows, int), 0)), arrays[name][rows, 0], err_msg=name
                    )


def test_join_stacks_objects():
    records = {
        name: {
            spec: value[0]
            for spec, value in arrays_of("grasps", 1, grasps=3, rng=np.random.default_rng(seed)).items()
            if spec in CONTRACT["grasps"].arrays and spec != "object"
        }
        for seed, name in enumerate(("knife-0004", "knife-0009"))
    }
    joined = join("grasps", records)
    assert joined["object"].tolist() == ["knife-0004", "knife-0009"]
    assert joined["penetration"].shape == (2, 3)
    assert joined["attempts"].tolist() == [records["knife-0004"]["attempts"], records["knife-0009"]["attempts"]]
    np.testing.assert_array_equal(joined["palm_pose"][1], records["knife-0009"]["palm_pose"])


def test_reading_a_dataset_loads_no_engine():
    code = "import palpate, sys; palpate.Dataset; print(*sys.modules)"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    engines = {"bpy", "mujoco", "embreex", "igl", "trimesh", "torch", "pandas"}
    assert not engines & set(output.stdout.split())


ZARR = [stage for stage in STAGES if CONTRACT[stage].stage.suffix == ".zarr"]


@pytest.mark.parametrize("stage", ZARR)
def test_every_axis_has_a_name_by_which_lengths_agree(tmp_path, stage):
    """xarray asks for this: names that differ within an array, and one length a name within a store."""
    path, lengths = path_of(tmp_path, stage), {}
    write(path, stage, arrays_of(stage, 2), ATTRIBUTES)
    for name in CONTRACT[stage].arrays:
        header = json.loads((path / name / "zarr.json").read_text())
        names = header["dimension_names"]
        assert len(names) == len(header["shape"]) == len(set(names)), name
        for axis, length in zip(names, header["shape"], strict=True):
            assert lengths.setdefault(axis, length) == length, (name, axis)
        assert name not in names or len(names) == 1  # else xarray takes it for a coordinate
    assert lengths["object"] == 2


def test_the_names_are_words_of_the_field():
    expected = ["object", "grasp", "sensor", "row", "column", "colour"]
    assert list(CONTRACT["touch"].arrays["reading"].dimensions) == expected
    expected = ["object", "grasp", "camera", "image_row", "image_column", "channel"]
    assert list(CONTRACT["vision"].arrays["occluded"].dimensions) == expected
    assert CONTRACT["grasps"].arrays["palm_pose"].dimensions == ("object", "grasp", "pose_row", "pose_column")


@pytest.mark.parametrize("stage", ZARR)
def test_xarray_opens_a_store(tmp_path, stage):
    xarray = pytest.importorskip("xarray", reason="no xarray here (envs/xarray.in)")
    arrays = arrays_of(stage, 2)
    write(path_of(tmp_path, stage), stage, arrays, ATTRIBUTES)
    found = xarray.open_zarr(path_of(tmp_path, stage), consolidated=False, chunks=None)
    assert set(found.variables) == set(arrays)
    for name, values in arrays.items():
        assert found[name].dims == CONTRACT[stage].arrays[name].dimensions
        np.testing.assert_array_equal(found[name].values, values, err_msg=name)
        assert name == "object" or found[name].dtype == values.dtype


def test_a_store_without_names_of_its_axes_reads_the_same(tmp_path):
    """They are for other readers."""
    arrays = arrays_of("touch", 2)
    path = path_of(tmp_path, "touch")
    write(path, "touch", arrays, ATTRIBUTES)
    for file in path.glob("*/zarr.json"):
        header = json.loads(file.read_text())
        file.write_text(json.dumps({key: each for key, each in header.items() if key != "dimension_names"}))
    seal.write(path)
    assert_same(read(path), arrays)
