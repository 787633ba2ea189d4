import io
import shutil

import numpy as np
import pandas as pd
import pytest
import zarr

from palpate.results import dataset_tables as tables
from palpate.results.dataset_tables import TOTAL
from palpate.results.published import paper_values
from palpate.results.tables import write_table

OBJECTS = pd.DataFrame(
    [
        ("bottle-0", "bottle", "train"),
        ("bottle-1", "bottle", "test"),
        ("bottle-2", "bottle", "train"),
        ("lamp-0", "lamp", "validation"),
        ("sock-0", "sock", "train"),
    ],
    columns=["object", "class", "split"],
)
REJECTED = pd.DataFrame(
    [("bottle-2", "meshes", "empty"), ("sock-0", "grasps", "flat")], columns=["object", "stage", "reason"]
)
GRASPS = pd.DataFrame(
    [
        ("bottle-0", "bottle", 1, 4, 7),
        ("bottle-0", "bottle", 3, 4, 7),
        ("bottle-1", "bottle", 3, 4, 6),
        ("bottle-1", "bottle", 4, 4, 6),
        ("lamp-0", "lamp", 2, 4, 9),
        ("lamp-0", "lamp", 2, 4, 9),
    ],
    columns=["object", "class", "successful_touches", "touches", "attempts"],
)
FRAMES = tables.Frames(OBJECTS, REJECTED, GRASPS)


def test_dataset_statistics_counted_by_hand():
    table = tables.dataset_statistics(FRAMES).set_index("class")
    assert list(table.index) == ["bottle", "lamp", "sock", TOTAL]
    counts = table[["objects", "grasps", "touches", "attempted", "rejected", "train", "validation", "test"]]
    assert counts.to_numpy().tolist() == [
        [2, 4, 16, 3, 1, 1, 0, 1],
        [1, 2, 8, 1, 0, 0, 1, 0],
        [0, 0, 0, 1, 1, 0, 0, 0],
        [3, 6, 24, 5, 2, 1, 1, 1],
    ]
    assert table["successful_percent"].round(2).tolist()[:2] == [68.75, 50.0]
    assert table.loc[TOTAL, "successful_percent"] == 62.5
    assert np.isnan(table.loc["sock", "successful_percent"]) and np.isnan(table.loc["sock", "attempts"])
    assert table.loc["bottle", "attempts"] == 6.5
    # Of two bottles the interval is Student's with one degree of freedom: wider than a share can be.
    assert table.loc["bottle", ["successful_low", "successful_high"]].tolist() == [0, 100]
    assert np.isnan(table.loc["lamp", "successful_low"]) and np.isnan(table.loc[TOTAL, "successful_low"])


def test_the_papers_values_stand_beside_those_of_the_same_class():
    table = tables.dataset_statistics(FRAMES).set_index("class")
    assert table.loc["bottle", "objects_paper"] == 487
    assert table.loc["bottle", "successful_percent_paper"] == 71.8
    assert table.loc[TOTAL, ["train_paper", "validation_paper", "test_paper"]].tolist() == [1298, 258, 175]
    assert table.loc["lamp"].filter(like="_paper").isna().all()
    note = tables.dataset_statistics(FRAMES).attrs["note"]
    assert "This run: 3 objects, 6 grasps" in note and "1731" in note and "1732" in note


def test_grasp_success_counted_by_hand():
    table = tables.grasp_success(FRAMES).set_index(["class", "successful_touches"])
    assert table.loc["bottle", "percent"].tolist() == [0, 25, 0, 50, 25]
    assert table.loc["lamp", "percent"].tolist() == [0, 0, 100, 0, 0]
    assert table.loc["sock", "percent"].isna().all() and (table.loc["sock", "grasps"] == 0).all()
    assert table.loc[TOTAL, "percent"].tolist() == pytest.approx([0, 16.67, 33.33, 33.33, 16.67])
    assert table.loc[TOTAL, "percent_paper"].tolist() == [0, 9.47, 26.08, 53.83, 10.61]
    assert table.loc["bottle", "percent_paper"].isna().all()
    assert table.loc[("bottle", 1), ["percent_low", "percent_high"]].tolist() == [0, 100]
    assert table.loc[("bottle", 0), ["percent_low", "percent_high"]].isna().all()  # none of two is not none of all


def test_a_run_in_which_everything_was_rejected_has_tables():
    nothing = FRAMES._replace(grasps=GRASPS.iloc[:0])
    assert tables.dataset_statistics(nothing)["grasps"].sum() == 0
    assert tables.grasp_success(nothing)["percent"].isna().all()


def test_the_papers_own_sums():
    """The reference file was typed in by hand: its classes and splits must add up to its totals."""
    values = paper_values("dataset_statistics").set_index(["class", "quantity"])["value"].unstack()
    classes = values.drop(index=TOTAL)
    for quantity in ("objects", "grasps", "touches"):
        assert classes[quantity].sum() == values.loc[TOTAL, quantity]
    assert (classes["grasps"] == 5 * classes["objects"]).all()
    assert (classes["touches"] == 4 * classes["grasps"]).all()
    assert values.loc[TOTAL, ["train", "validation", "test"]].sum() == values.loc[TOTAL, "objects"]
    assert paper_values("grasp_success")["value"].sum() == pytest.approx(100, abs=0.02)


def test_the_frames_of_a_run(run):
    objects, rejected, grasps = tables.dataset_frames(run)
    assert objects["object"].tolist() == ["bottle-0000", "bottle-0001", "knife-0000", "sock-0000"]
    assert rejected[["object", "stage"]].to_numpy().tolist() == [["sock-0000", "grasps"]]
    assert grasps["object"].tolist() == np.repeat(objects["object"][:3], 2).tolist()
    assert grasps["class"].tolist() == ["bottle"] * 4 + ["knife"] * 2
    depth = zarr.open_group(run / "touch" / "batch-0000.zarr", mode="r")["depth"][:]
    touched = np.isfinite(depth).any(axis=(3, 4)).sum(axis=2).ravel().tolist()
    assert grasps["successful_touches"].tolist() == touched
    assert (grasps["attempts"] == 7).all() and (grasps["touches"] == 4).all()
    table = tables.dataset_statistics(tables.Frames(objects, rejected, grasps)).set_index("class")
    assert table.loc["sock", ["attempted", "rejected", "objects"]].tolist() == [1, 1, 0]


def test_the_tables_need_no_vision_store_and_no_meshes(run, tmp_path):
    for name in ("catalogue.csv", "rejected.csv"):
        shutil.copy(run / name, tmp_path)
    for stage in ("grasps", "touch"):
        shutil.copytree(run / stage, tmp_path / stage)
    pd.testing.assert_frame_equal(tables.dataset_frames(tmp_path).grasps, tables.dataset_frames(run).grasps)


def test_the_tables_do_not_depend_on_what_vision_rejected(run, tmp_path):
    whole = shutil.copytree(run, tmp_path / "run")
    for name, stage in {"bottle-0000": "vision", "sock-0000": "grasps"}.items():
        path = whole / f"rejected/{stage}/batch-0000.csv"
        path.parent.mkdir(parents=True)
        path.write_text(f"object,stage,reason\n{name},{stage},x\n")
    frames = zip(tables.dataset_frames(whole), tables.dataset_frames(run), strict=True)
    for found, expected in frames:
        columns = [column for column in expected if column != "reason"]
        pd.testing.assert_frame_equal(found[columns], expected[columns])


def test_the_frames_of_a_run_in_which_everything_was_rejected(run, tmp_path):
    shutil.copy(run / "catalogue.csv", tmp_path)
    names = [line.split(",")[0] for line in (run / "catalogue.csv").read_text().splitlines()[1:]]
    (tmp_path / "rejected.csv").write_text("object,stage,reason\n" + "".join(f"{n},meshes,x\n" for n in names))
    frames = tables.dataset_frames(tmp_path)
    assert len(frames.grasps) == 0
    table = tables.dataset_statistics(frames).set_index("class")
    assert table.loc[TOTAL, ["attempted", "rejected", "objects"]].tolist() == [4, 4, 0]


def test_csv_and_markdown_hold_the_same_cells(tmp_path):
    table = tables.dataset_statistics(FRAMES)
    write_table(table, tmp_path / "new" / "statistics.csv")
    from_csv = pd.read_csv(tmp_path / "new" / "statistics.csv", dtype=str, keep_default_na=False)
    lines = (tmp_path / "new" / "statistics.md").read_text().splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    assert rows[0] == [column.replace("_", " ") for column in from_csv.columns]
    assert [["" if cell == "–" else cell for cell in row] for row in rows[2:]] == from_csv.to_numpy().tolist()
    assert lines[-1] == table.attrs["note"]


def test_a_written_table_reads_back(tmp_path):
    table = tables.grasp_success(FRAMES)
    write_table(table, tmp_path / "a.csv")
    pd.testing.assert_frame_equal(pd.read_csv(io.StringIO((tmp_path / "a.csv").read_text())), table, check_dtype=False)
