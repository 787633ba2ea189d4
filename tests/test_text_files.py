"""Tables and records say when they are not as they were written."""

import pytest

from palpate import seal
from palpate.atomic import atomic_write
from palpate.seal import DamagedFile
from palpate.text_files import read_record, read_rows, read_text

ROWS = "object,stage,reason\nbottle-0001,grasps,too few grasps\nbottle-0002,touch,none\n"


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "x.csv"
    with atomic_write(path, seal.NOTHING) as partial:
        partial.write_text(ROWS)
    return path


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
    assert [row["object"] for row in read_rows(table, ["object"])] == ["bottle-0001", "bottle-0002"]
    table.unlink() if content is None else table.write_bytes(content)
    with pytest.raises(DamagedFile, match=said) as error:
        read_rows(table, ["object"])
    assert str(table) in str(error.value) and "build it" in str(error.value)


def test_a_table_without_a_seal_is_taken_if_it_is_a_table(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text(ROWS)
    assert len(read_rows(path, ["object", "stage"])) == 2
    for text, said in (
        ("object,stage\na,b,c\n", "has one too many, in row 1"),
        ("object,stage\na,b\nc\n", "lacks a value, .* in row 2"),
        ("object\na\n", "has no column 'stage'"),
        ('object,stage\n"a,b\n', "is not a valid CSV file"),
    ):
        path.write_text(text)
        with pytest.raises(DamagedFile, match=said):
            read_rows(path, ["object", "stage"])


def test_a_field_may_hold_any_line_break(tmp_path):
    path, reason = tmp_path / "x.csv", "one\ntwo\u2028three\x0bfour"
    path.write_text(f'object,reason\na,"{reason}"\n')
    assert read_rows(path, ["object"]) == [{"object": "a", "reason": reason}]


def test_a_record_that_is_no_json_is_an_error(tmp_path):
    path = tmp_path / "x.json"
    for text, said in (('{"steps": 3\n', "is not valid JSON"), ("[3]\n", "is not a JSON object")):
        path.write_text(text)
        with pytest.raises(DamagedFile, match=said):
            read_record(path)
    path.write_text('{"steps": 3}\n')
    assert read_record(path) == {"steps": 3}


def test_writing_again_renews_the_seal_and_writing_without_one_removes_it(table):
    with atomic_write(table, seal.NOTHING) as partial:
        partial.write_text("object\nx\n")
    assert read_rows(table, ["object"]) == [{"object": "x"}]
    with atomic_write(table) as partial:
        partial.write_text("object\ny\n")
    assert read_rows(table, ["object"]) == [{"object": "y"}]


def test_a_table_without_a_seal_is_an_error_in_a_run(tmp_path):
    """There its job has sealed it. A folder is a run's from the moment that the workflow starts in it."""
    table = tmp_path / "tables/x.csv"
    table.parent.mkdir()
    table.write_text(ROWS)
    assert read_text(table) == ROWS
    with atomic_write(tmp_path / "batches.json", seal.NOTHING) as partial:
        partial.write_text("{}\n")
    with pytest.raises(DamagedFile, match=r"it has no seal .*\.x\.csv\.seal\.json.*; remove it and build it again"):
        read_text(table)
    with atomic_write(table, seal.NOTHING) as partial:
        partial.write_text(ROWS)
    assert read_text(table) == ROWS
