"""The tables of a run with classes of its own: without the paper's columns, in CSV, Markdown and LaTeX."""

import numpy as np
import pandas as pd
import pytest

from palpate.results import claims, dataset_tables, model_tables
from palpate.results.tables import write_table
from tests.learning import synthetic

OWN = {"bottle": "lamp", "knife": "mug", "cellphone": "sock", "rifle": "total"}  # sorted as theirs are
MIXED = OWN | {"rifle": "rifle"}
EFFECTS = {"effects": claims.touch_effect, "by_class": claims.touch_effect_by_class}


def frames(names: dict[str, str]) -> dataset_tables.Frames:
    objects = pd.DataFrame([(f"{name}-{k}", name, "train") for name in names.values() for k in range(3)])
    objects.columns = ["object", "class", "split"]
    grasps = objects.drop(columns="split").assign(successful_touches=[1, 2, 4] * len(names), touches=4)
    return dataset_tables.Frames(
        objects,
        pd.DataFrame(columns=["object", "stage", "reason"]),
        grasps.assign(attempts=5.0),
    )


@pytest.fixture(scope="module")
def measured():
    evaluations = synthetic.evaluations(synthetic.published_means(), each=4)
    return {
        "evaluations": evaluations,
        "rings": synthetic.rings(synthetic.published_rings(), each=4),
        "touches": synthetic.touches(0.01, each=4),
    }


def all_tables(measured, names):
    own = {key: frame.replace({"class": names}) for key, frame in measured.items()}
    found = {name: getattr(dataset_tables, name)(frames(names)) for name in ("dataset_statistics", "grasp_success")}
    published = synthetic.published_means()
    for name in ("model_selection", "input_modalities", "grasps"):
        setup = {key: row for key, row in synthetic.of_table(name).items() if key in published}
        found[name] = getattr(model_tables, name)(own["evaluations"], setup, resamples=50)
    found["extrapolation"] = model_tables.extrapolation(own["rings"], synthetic.of_table("extrapolation"), resamples=50)
    found["local_touch_charts"] = model_tables.local_touch_charts(own["touches"], resamples=50)
    found["claims"] = claims.decide(**own, resamples=50)
    return found | {name: table(own["evaluations"], resamples=50) for name, table in EFFECTS.items()}


def test_without_the_papers_classes_no_table_has_its_columns(measured, tmp_path):
    papers = all_tables(measured, {name: name for name in OWN})
    for name, table in all_tables(measured, OWN).items():
        theirs = [column for column in papers[name] if "paper" in column]
        ours = [OWN.get(column, column) for column in papers[name] if column not in theirs]
        ours = [OWN.get(stem, stem) + end for stem, end in map(parted, ours)]
        assert theirs and list(table.columns) == ours, name
        np.testing.assert_allclose(numbers(table), numbers(papers[name].drop(columns=theirs)))  # nothing else changes
        write_table(table, tmp_path / f"{name}.csv")
        for form in ("md", "tex"):
            head = (tmp_path / f"{name}.{form}").read_text().splitlines()
            assert not [line for line in head if "|" in line or "&" in line if "paper" in line.replace("(paper)", "")]
        assert "the paper:" not in table.attrs["note"] and "The paper counts" not in table.attrs["note"]


def test_with_one_of_the_papers_classes_its_columns_stay(measured):
    for name, table in all_tables(measured, MIXED).items():
        assert [column for column in table if "paper" in column], name


def parted(column: str) -> tuple[str, str]:
    for end in ("_low", "_high"):
        if column.endswith(end):
            return column.removesuffix(end), end
    return column, ""


def numbers(table: pd.DataFrame) -> np.ndarray:
    """All but the intervals: their random numbers go by the classes' names."""
    bounds = [column for column in table if column.endswith(("_low", "_high"))]
    return table.drop(columns=bounds).select_dtypes("number").to_numpy(float)
