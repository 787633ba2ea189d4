"""Tables, records and folders say when they are not as they were written."""

import subprocess

import pytest

from palpate import checksums
from palpate.atomic import atomic_write
from palpate.checksums import DamagedFile

REMEDY = "build it again with: snakemake x.csv"
ROWS = "object,stage,reason\nbottle-0001,grasps,too few grasps\nbottle-0002,touch,none\n"


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "x.csv"
    with atomic_write(path, checksum=True) as partial:
        partial.write_text(ROWS)
    return path


def test_checksums_are_those_of_sha256sum(table):
    assert checksums.size_and_sha256(table)[0] == len(ROWS)
    done = subprocess.run(["sha256sum", "--check", ".x.csv.sha256"], cwd=table.parent, capture_output=True, text=True)
    assert done.stdout == "x.csv: OK\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b" \n\n", "is empty"),
        (b"\x89PNG\xff\xfe\n", "is not text"),
        (bytes(100), "is not text"),
        (ROWS[:-5].encode(), "is cut off"),
        (ROWS[: ROWS.index("bottle-0002")].encode(), "has changed since it was written"),  # cut at the end of a line
        (ROWS.replace("0002", "0003").encode(), "has changed since it was written"),
        (None, "does not exist"),
    ],
)
def test_a_damaged_table_is_an_error_that_names_file_and_remedy(table, content, said):
    assert [row["object"] for row in checksums.read_rows(table, ["object"], REMEDY)] == ["bottle-0001", "bottle-0002"]
    assert checksums.changed(table.parent) == []
    table.unlink() if content is None else table.write_bytes(content)
    with pytest.raises(DamagedFile, match=said) as error:
        checksums.read_rows(table, ["object"], REMEDY)
    assert str(table) in str(error.value) and REMEDY in str(error.value)
    assert checksums.changed(table.parent) == ([] if content is None else [table])


def test_a_table_without_a_checksum_is_taken_if_it_is_a_table(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text(ROWS)
    assert len(checksums.read_rows(path, ["object", "stage"], REMEDY)) == 2
    for text, said in (
        ("object,stage\na,b,c\n", "has one too many, in row 1"),
        ("object,stage\na,b\nc\n", "lacks a value, .* in row 2"),
        ("object\na\n", "has no column 'stage'"),
        ('object,stage\n"a,b\n', "is not a valid CSV file"),
    ):
        path.write_text(text)
        with pytest.raises(DamagedFile, match=said):
            checksums.read_rows(path, ["object", "stage"], REMEDY)


def test_a_field_may_hold_any_line_break(tmp_path):
    path, reason = tmp_path / "x.csv", "one\ntwo\u2028three\x0bfour"
    path.write_text(f'object,reason\na,"{reason}"\n')
    assert checksums.read_rows(path, ["object"], REMEDY) == [{"object": "a", "reason": reason}]


def test_a_record_that_is_no_json_is_an_error(tmp_path):
    path = tmp_path / "x.json"
    for text, said in (('{"steps": 3\n', "is not valid JSON"), ("[3]\n", "is not a JSON object")):
        path.write_text(text)
        with pytest.raises(DamagedFile, match=said):
            checksums.read_record(path, REMEDY)
    path.write_text('{"steps": 3}\n')
    assert checksums.read_record(path, REMEDY) == {"steps": 3}


def test_writing_again_renews_the_checksum_and_writing_without_one_removes_it(table):
    with atomic_write(table, checksum=True) as partial:
        partial.write_text("object\nx\n")
    assert checksums.read_rows(table, ["object"], REMEDY) == [{"object": "x"}]
    with atomic_write(table) as partial:
        partial.write_text("object\ny\n")
    assert checksums.read_rows(table, ["object"], REMEDY) == [{"object": "y"}]


def test_a_folder_says_what_is_missing_cut_and_changed(tmp_path):
    for name in ("a/visual.glb", "a/mesh.json", "b/visual.glb"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"content of " + name.encode())
    (tmp_path / "a/.snakemake_timestamp").touch()
    checksums.write_manifest(tmp_path)
    files = checksums.read_manifest(tmp_path, REMEDY)
    assert list(files) == ["a/mesh.json", "a/visual.glb", "b/visual.glb"]
    assert checksums.find_damage(tmp_path, files, contents=True) == []
    (tmp_path / "a/mesh.json").unlink()
    (tmp_path / "a/visual.glb").write_bytes(b"short")
    (tmp_path / "b/visual.glb").write_bytes(b"Content of b/visual.glb")
    lost = ["a/mesh.json is missing", "a/visual.glb has 5 bytes, but 23 were written"]
    assert checksums.find_damage(tmp_path, files) == lost
    changed = "b/visual.glb has changed since it was written (checksum)"
    assert checksums.find_damage(tmp_path, files, contents=True) == [*lost, changed]
    for content in (b"", b"{", b'{"a": 3}', b"[1]"):
        (tmp_path / checksums.MANIFEST).write_bytes(content)
        with pytest.raises(DamagedFile, match="manifest.json can't be read"):
            checksums.read_manifest(tmp_path, REMEDY)
    (tmp_path / checksums.MANIFEST).unlink()
    with pytest.raises(DamagedFile, match="manifest.json does not exist"):
        checksums.read_manifest(tmp_path, REMEDY)
