"""The catalogue table: rows, batches, relative sources, checksums."""

import hashlib
import json
import os

import pytest

from palpate.catalogue import COLUMNS, CatalogueError, Source, build, checksum, scan, write_catalogue
from palpate.catalogue.table import companions
from palpate.dataset.run import Run
from palpate.dataset.validation import combine_validation
from tests.catalogue.whole import whole_catalogue
from tests.mesh import nasty


@pytest.fixture
def source(tmp_path):
    for i in range(7):
        path = tmp_path / "meshes" / ("mug" if i < 4 else "pan") / f"{i}.obj"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"v {i} 0 0\n")
    return Source("folder", tmp_path / "meshes")


def test_rows(source):
    table = whole_catalogue(source, {"pan": "all", "mug": 4}, batches=3)
    assert tuple(table.columns) == COLUMNS
    assert list(table["class"]) == ["pan"] * 3 + ["mug"] * 4
    assert list(table["batch"]) == ["batch-0000"] * 3 + ["batch-0001"] * 3 + ["batch-0002"]
    assert list(table["source"])[:2] == ["pan/4.obj", "pan/5.obj"]
    assert table["object"].is_unique
    assert set(table["split"]) <= {"train", "validation", "test"}
    for row in table.itertuples():
        assert row.checksum == hashlib.sha256((source.path / row.source).read_bytes()).hexdigest()


def test_other_objects_change_no_row_but_its_batch(source):
    before = whole_catalogue(source, {"mug": "all", "pan": "all"}, batches=2).set_index("object")
    (source.path / "mug" / "00.obj").write_text("new")
    after = whole_catalogue(source, {"mug": "all", "pan": "all"}, batches=2).set_index("object")
    same = ["class", "split", "source", "checksum"]
    assert after.loc[before.index, same].equals(before[same])


def test_procedural_files_must_be_there_for_the_table(tmp_path):
    with pytest.raises(CatalogueError, match="bottle-0000.glb: no such file"):
        whole_catalogue(Source("procedural", tmp_path), {"bottle": 1})


def test_checksum_covers_materials_and_textures(tmp_path):
    """It changes when any of the files that make the object changes, and with no other."""
    path = tmp_path / "texture_obj.obj"
    nasty.USABLE["texture_obj/texture_obj.obj"](path)
    texture = next(tmp_path.glob("*.png"))
    assert companions(path) == sorted(["texture_obj.mtl", texture.name])
    seen = {checksum(path)}
    (tmp_path / "other.png").write_bytes(b"")
    assert checksum(path) in seen
    for changed in (texture, tmp_path / "texture_obj.mtl", path):
        changed.write_bytes(changed.read_bytes() + b"\n")
        assert checksum(path) not in seen
        seen.add(checksum(path))


def test_companions_of_obj_with_options_and_missing_files(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib a b.mtl\nmtllib gone.mtl\nv 0 0 0\n")
    (tmp_path / "a b.mtl").write_text(
        "newmtl m\nmap_Kd -s 2 2 2 wood grain.png\nmap_Bump -bm 0.2 bump.png\n norm n.png\n"
    )
    for name in ("wood grain.png", "bump.png", "n.png", "unused.png"):
        (tmp_path / name).write_bytes(b"")
    assert companions(tmp_path / "a.obj") == ["a b.mtl", "bump.png", "n.png", "wood grain.png"]
    assert companions(tmp_path / "a.obj", head=16) == companions(tmp_path / "a.obj")
    assert companions(tmp_path / "a.obj", head=3) == []


def test_companions_of_gltf_and_collada(tmp_path):
    tree = {"buffers": [{"uri": "a%20b.bin"}, {"uri": "data:,x"}, {}], "images": [{"uri": "i.png"}, {"bufferView": 0}]}
    (tmp_path / "m.gltf").write_text(json.dumps(tree))
    (tmp_path / "m.dae").write_text("<COLLADA><image><init_from>i.png</init_from></image></COLLADA>")
    (tmp_path / "broken.gltf").write_text("{")
    for name in ("a b.bin", "i.png"):
        (tmp_path / name).write_bytes(b"")
    assert companions(tmp_path / "m.gltf") == ["a b.bin", "i.png"]
    assert companions(tmp_path / "m.dae") == ["i.png"]
    assert companions(tmp_path / "broken.gltf") == []


def test_validation_names_a_source_that_has_changed_and_the_command(source):
    """By its checksum, also if it is as large and as old as before; a run whose sources are not there has none."""
    run = source.path.parent / "run"
    run.mkdir()
    entries = [entry._replace(split="train") for entry in scan(source, {"mug": 4})]
    rows = build(source.path, entries, {entry.object: "batch-0000" for entry in entries})
    write_catalogue(run / "catalogue.csv", rows)
    (run / "config.yaml").write_text(json.dumps({"source": {"path": str(source.path)}}))
    assert combine_validation([], run, Run(run).sources).passed.all()
    changed = source.path / "mug/2.obj"
    times = changed.stat()
    changed.write_text("v 9 0 0\n")
    os.utime(changed, ns=(times.st_atime_ns, times.st_mtime_ns))
    table = combine_validation([], run, Run(run).sources).set_index("check")
    assert not table.passed["sources"] and str(changed) in table["where"]["sources"]
    assert f"snakemake dataset --cores 2 --configfile {run}/config.yaml" in table["where"]["sources"]
    (run / "config.yaml").write_text(json.dumps({"source": {"path": "/moved/away"}}))
    assert Run(run).sources is None and combine_validation([], run, Run(run).sources).passed.all()
