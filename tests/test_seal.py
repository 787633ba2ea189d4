"""Seals: one for each kind of output, verified and compared by the same functions."""

import hashlib
import io
import json
import os
import shutil
import zipfile

import h5py
import numpy as np
import pytest
import torch

from palpate import seal
from palpate.atomic import atomic_write
from palpate.seal import DamagedFile, MixedInputs, combine, made_of

MADE_FROM = {"inputs": {"sources": "ab" * 32}, "config": {"seed": 0, "vision.size": 256}}


def write_file(path):
    path.write_bytes(b"object\na\n")


def write_folder(path):
    for name in ("a/visual.glb", "a/mesh.json", "b/visual.glb"):
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(b"content of " + name.encode())


def write_hdf5(path):
    with h5py.File(path, "w", userblock_size=seal.USER_BLOCK) as file:
        file["x"] = np.arange(1000)


def write_checkpoint(path):
    content = io.BytesIO()  # a file's name would be in it
    torch.save({"weights": torch.arange(1000.0)}, content)
    path.write_bytes(content.getvalue())


KINDS = {"x.csv": write_file, "batch-0000": write_folder, "x.h5": write_hdf5, "x.ckpt": write_checkpoint}


@pytest.fixture(params=KINDS)
def output(request, tmp_path):
    """A sealed output of each kind."""
    path = tmp_path / "run" / "stage" / request.param
    with atomic_write(path, MADE_FROM) as partial:
        KINDS[request.param](partial)
    return path


def files_of(path):
    """All files of an output and its seal."""
    return sorted(file for file in path.parent.rglob("*") if file.is_file())


def test_a_seal_says_what_an_output_holds_and_what_it_was_made_from(output):
    sealed = seal.verify(output)
    assert sealed.made_from == MADE_FROM and sealed.label == f"stage/{output.name}"
    names = ["a/mesh.json", "a/visual.glb", "b/visual.glb"] if output.is_dir() else [output.name]
    assert list(sealed.files) == names
    if output.suffix not in seal.WITHIN:
        for name, (size, digest) in sealed.files.items():
            content = (output if output.is_dir() else output.parent).joinpath(name).read_bytes()
            assert (size, digest) == (len(content), hashlib.sha256(content).hexdigest())


def test_what_has_its_seal_within_stays_readable_and_is_copied_with_it(output, tmp_path):
    if output.suffix == ".h5":
        with h5py.File(output) as file:
            np.testing.assert_array_equal(file["x"], np.arange(1000))
    if output.suffix == ".ckpt":
        assert zipfile.ZipFile(output).testzip() is None
        assert torch.equal(torch.load(output, weights_only=True)["weights"], torch.arange(1000.0))
    if output.suffix in seal.WITHIN or output.is_dir():
        copy = shutil.copytree if output.is_dir() else shutil.copy
        assert seal.verify(copy(output, tmp_path / output.name)).digest == seal.read(output).digest


def test_no_altered_bit_passes(output):
    rng = np.random.default_rng(0)
    for file in files_of(output):
        content = file.read_bytes()
        for place in rng.choice(len(content), min(len(content), 200), replace=False):
            altered = bytearray(content)
            altered[place] ^= 1 << rng.integers(8)
            file.write_bytes(altered)
            with pytest.raises(DamagedFile, match=f"{output.name} .*remove .* and build it again"):
                seal.verify(output)
        file.write_bytes(content)
    seal.verify(output)


def test_a_lost_or_shortened_file_is_named(output):
    for file in files_of(output):
        content = file.read_bytes()
        for kept in (0, len(content) // 2, len(content) - 1):
            file.write_bytes(content[:kept])
            with pytest.raises(DamagedFile, match=output.name):
                seal.verify(output)
        file.unlink()
        with pytest.raises(DamagedFile, match="is missing|has no seal|does not exist"):
            seal.verify(output)
        file.write_bytes(content)


def test_each_damaged_file_is_named(tmp_path):
    write_folder(tmp_path)
    (tmp_path / "a/.snakemake_timestamp").touch()
    seal.write(tmp_path)
    sealed = seal.verify(tmp_path)
    (tmp_path / "a/mesh.json").unlink()
    (tmp_path / "a/visual.glb").write_bytes(b"short")
    (tmp_path / "b/visual.glb").write_bytes(b"Content of b/visual.glb")
    lost = r"is damaged: a/mesh.json is missing; a/visual.glb has 5 bytes, but 23 were written; "
    with pytest.raises(DamagedFile, match=f"{lost}remove "):
        sealed.require(contents=False)
    with pytest.raises(
        DamagedFile, match=rf"{lost}b/visual.glb has changed since it was written \(checksum\); remove "
    ):
        sealed.require()
    sealed.require(["b/visual.glb"], contents=False)


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"version": 1}', '{"version": 99}', '{"version": 1, "files": 3}'])
def test_other_text_is_no_seal(tmp_path, text):
    (tmp_path / seal.NAME).write_text(text)
    with pytest.raises(DamagedFile, match=r"is damaged: its seal .*seal\.json\) .*another version of palpate"):
        seal.read(tmp_path)


def test_the_same_output_has_the_same_seal_wherever_it_is(output, tmp_path):
    again = tmp_path / "elsewhere" / "stage" / output.name
    with atomic_write(again, MADE_FROM) as partial:
        KINDS[output.name](partial)
    os.utime(again, (1, 1))
    assert seal.text_of(again) == seal.text_of(output)


def test_another_output_or_history_has_another_digest(tmp_path):
    digests = set()
    for text, made_from in (("a", {}), ("b", {}), ("a", MADE_FROM), ("a", {"config": {"seed": 1}})):
        with atomic_write(tmp_path / "x.csv", made_from) as partial:
            partial.write_text(text)
        digests.add(seal.read(tmp_path / "x.csv").digest)
    assert len(digests) == 4


def sealed_file(path, made_from=seal.NOTHING, text="x"):
    with atomic_write(path, made_from) as partial:
        partial.write_text(text)
    return seal.read(path)


def test_inputs_of_a_job_have_to_fit_together(tmp_path):
    meshes = sealed_file(tmp_path / "meshes/batch-0000.csv", combine({"mesh": {"faces": 4000}}))
    grasps = sealed_file(tmp_path / "grasps/batch-0000.csv", combine({"grasps": {"share": 0.15}}, meshes))
    assert grasps.inputs == {"meshes/batch-0000.csv": meshes.digest}
    assert grasps.config == {"grasps.share": 0.15, "mesh.faces": 4000}
    touch = combine({"seed": 0}, meshes, grasps)
    assert touch["inputs"] == {**grasps.inputs, "grasps/batch-0000.csv": grasps.digest}
    other = sealed_file(tmp_path / "meshes/batch-0000.csv", combine({"mesh": {"faces": 2000}}))
    with pytest.raises(MixedInputs, match="made with mesh.faces = 4000, but the run has 2000; from other meshes/batch"):
        combine({}, other, grasps)
    with pytest.raises(MixedInputs, match="made with grasps.share = 0.15, but the run has 0.2"):
        combine({"grasps": {"share": 0.2}}, meshes, grasps)


def test_batches_of_a_stage_are_one_input(tmp_path):
    (tmp_path / "catalogue.csv").write_text("plain")
    paths = [tmp_path / f"touch/batch-{number:04d}.csv" for number in (0, 1, 12)]
    seals = [sealed_file(path, text=path.name) for path in paths]
    alone, table = sealed_file(tmp_path / "vision/batch-0003.csv"), sealed_file(tmp_path / "evaluations/a/seed-0.csv")
    everything = [*reversed(paths), table.path, alone.path, tmp_path / "catalogue.csv"]
    inputs = made_of(everything, {"points": 3})["inputs"]
    together, of_all = "touch/batch-{0000,0001,0012}.csv", "\n".join(each.digest for each in seals)
    assert inputs == {
        "evaluations/a/seed-0.csv": table.digest,
        "vision/batch-0003.csv": alone.digest,
        together: hashlib.sha256(of_all.encode()).hexdigest(),
    }
    assert {label: seal.digest_in(tmp_path, label) for label in inputs} == inputs
    sealed_file(paths[1], text="changed")
    changed = {label for label, digest in inputs.items() if seal.digest_in(tmp_path, label) != digest}
    assert changed == {together}
    product = sealed_file(tmp_path / "tables/a.csv", {"inputs": inputs})
    difference = product.difference({}, lambda label: seal.digest_in(tmp_path, label))
    assert difference == "from other touch/batch-{0000..0012}.csv than the run has"
    paths[1].unlink()
    seal.beside(paths[1]).unlink()
    assert seal.digest_in(tmp_path, together) is None  # which does not count


def test_values_that_say_how_or_where_are_none_of_what_an_output_was_made_from():
    vision = {"size": 48, "device": "gpu", "exr": True, "cameras": {"count": 2, "device": "x"}}
    assert seal.by_path({"seed": 0, "vision": vision, "hand": {"mjcf": "a.xml"}}) == {
        **{"seed": 0, "vision.size": 48, "vision.cameras.count": 2}
    }


def test_a_seal_without_room_is_an_error(tmp_path):
    write_hdf5(tmp_path / "x.h5")
    with pytest.raises(ValueError, match="has no room"):
        seal.write(tmp_path / "x.h5", {"config": {"long": "x" * seal.USER_BLOCK}})


def test_a_seal_is_plain_json(output):
    stated = json.loads(seal.text_of(output))
    assert set(stated) == {"version", "digest", "made_from", "files"}
