"""Tables and figures as the workflow takes them from their functions: captions, and one that is new."""

import os
import re
import shutil
import subprocess
import sys

import pandas as pd
import pytest

from palpate import Dataset
from palpate.results.products import caption, position
from tests.workflow.conftest import PROJECT, run_snakemake

KINDS = (("tables", "csv"), ("figures", "png"))
DATASET = ["dataset_statistics", "grasp_success"]
NEW = '''
import pandas as pd

from palpate.results import products


@products.table(stores=("touch",), category="Dataset")
def touches_of_classes(dataset):
    """Successful touches of each class."""
    counts = {name: dataset.of_class(name).array("touch", "success")[:].sum() for name in dataset.classes}
    return pd.DataFrame(counts.items(), columns=["class", "touches"])
'''


def test_every_table_and_figure_has_a_caption_of_its_own():
    printed = run_snakemake(PROJECT, "--dry-run", "--forceall", "all").stdout
    tables, figures = (set(re.findall(rf"{kind}/(\S+?)\.{form}", printed)) for kind, form in KINDS)
    assert {"dataset_statistics", "touch_effect", "claims", "architectures/touch"} <= tables and "atlas" in figures
    captions = {name: caption("tables", name) for name in [*tables, "tuning"]}
    captions |= {name: caption("figures", name) for name in figures}
    # The layers of all models share a caption, and the examples of all classes but for the class.
    assert all(len(text) > 80 for text in captions.values()), [name for name in captions if len(captions[name]) <= 80]
    own = [text for name, text in captions.items() if not name.startswith("architectures/")]
    assert len({*own, captions["architectures/touch"]}) == len(own) + 1
    assert "of class bottle," in captions["examples_bottle"]
    assert "twelve models" in captions["model_selection"] and "hold the paper's values" in captions["model_selection"]


@pytest.mark.parametrize("name", DATASET)
def test_captions_of_the_dataset_say_nothing_of_seeds(name):
    assert "seeds" not in caption("tables", name)


def test_names_are_in_the_order_of_their_products():
    names = ["zzz", "architectures/touch", "claims", "touch_effect_by_class", "touch_effect", "dataset_statistics"]
    dataset_first, *others = sorted(names, key=lambda name: position("tables", name))
    assert dataset_first == "dataset_statistics" and others[-1] == "zzz"
    assert others.index("touch_effect") + 1 == others.index("touch_effect_by_class")  # as they stand in their module


def test_snakemakes_report_has_the_docstrings(finished, tmp_path):
    path = tmp_path / "report.html"
    result = finished("tables/dataset_statistics.csv", "figures/examples_can.png", "--report", str(path))
    assert result.returncode == 0, result.stderr
    report = path.read_text()
    # In its HTML: code between tags.
    assert "Size of the dataset by class and in total, how many objects each split has" in report
    assert re.search(r">successful_low<|\\u003esuccessful_low\\u003c", report) and "Examples of class can," in report


def test_a_new_table_is_one_function(finished, tmp_path):
    """In a copy of the project and of a run: nothing but the function names it, and the workflow makes it."""
    run = shutil.copytree(finished.run, tmp_path / "results" / finished.run.name)
    for name in ("workflow", "config", "envs", "profiles", "studies", "snakemake_logger_plugin_palpate"):
        (tmp_path / name).symlink_to(PROJECT / name)
    shutil.copytree(PROJECT / "palpate", tmp_path / "palpate", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "palpate/results/own.py").write_text(NEW)
    shutil.copy(PROJECT / "Snakefile", tmp_path)  # its folder is the project's
    options = ["--cores", "1", "--rerun-triggers", "mtime", "--configfile", str(finished.config)]
    options += ["--config", f"results={tmp_path / 'results'}"]
    for target in (["dataset", "--dry-run"], ["tables/touches_of_classes.tex"]):
        result = subprocess.run(
            [sys.executable, "-m", "snakemake", *target, *options],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert result.returncode == 0, result.stderr
        if "--dry-run" in target:
            assert "tables/touches_of_classes.csv" in result.stdout  # `dataset` makes it
    made = pd.read_csv(run / "tables/touches_of_classes.csv").set_index("class")["touches"]
    dataset = Dataset(finished.run)
    touched = {record.name: sum(grasp.success.sum() for grasp in record.grasps) for record in dataset}
    assert made["can"] == sum(count for name, count in touched.items() if dataset[name].class_name == "can") > 0
