"""A new table and a new stage, exactly as CONTRIBUTING.md says, in a copy of the checkout and of a run."""

import json
import os
import re
import shutil
import subprocess
import sys

import pandas as pd

import palpate
from tests.workflow.conftest import PROJECT

CONTRIBUTING = (PROJECT / "CONTRIBUTING.md").read_text()
COPIED = ("config", "docs", "envs", "palpate", "profiles", "studies", "workflow", "snakemake_logger_plugin_palpate")

# Step 1 of "A new stage": a row, and rows for its arrays.
ROW = "reach: {suffix: .zarr, reads: [meshes, grasps], rejects: true, in_dataset: true}\n"
ARRAYS = """\
reach,object,o,string,0,,,Names of the batch's objects; as in grasps
reach,corner,o coordinate:3,float64,0,0,m,Corner of the box around the object with the greatest coordinates; world frame
reach,palm_distance,o g,float32,0,0,m,Distance of the palm link from the middle of the object
"""
# Steps 2 and 3.
RULE = """\
rule reach:
    input:
        meshes="meshes/{batch}",
        grasps="grasps/{batch}.h5",
    output:
        reach=directory("reach/{batch}.zarr"),
        rejected="rejected/reach/{batch}.csv",
    log:
        "logs/reach/{batch}.log",
    params:
        seed=config["seed"],
    script:
        "../scripts/reach.py"
"""
SCRIPT = '''\
"""reach/<batch>.zarr, rejected/reach/<batch>.csv"""

from workflow.run.job import log_to

from pathlib import Path

import numpy as np

from palpate import mesh, seal, store
from palpate.batch import each_object

log_to(snakemake.log[0])
meshes, grasps, seed = Path(snakemake.input.meshes), store.open(snakemake.input.grasps), snakemake.params.seed
palms = dict(zip(grasps["object"], grasps["palm_pose"][:, :, :3, 3], strict=True))


def measure(name):
    middle = np.array(mesh.OBJECT_POSITION)
    distance = np.linalg.norm(palms[name] - middle, axis=-1).astype(np.float32)
    return {"corner": mesh.load_geometry(meshes / name).vertices.max(axis=0) + middle, "palm_distance": distance}


made_from = seal.combine({"seed": seed}, seal.read(meshes), grasps.seal)
store.write_batch(snakemake.output, "reach", each_object(palms, measure, "reach"), seed, made_from)
'''
READ = """
import sys
import numpy as np
import palpate
from palpate.command import main
from palpate.interchange.folder import export
from palpate.mesh import OBJECT_POSITION

folder = sys.argv[1]
dataset = palpate.Dataset(folder)
assert "reach" in dataset.stages, dataset.stages
for item, stored in zip(dataset, dataset.array("reach", "palm_distance")[:], strict=True):
    distances = [np.linalg.norm(grasp.palm_pose[:3, 3] - OBJECT_POSITION) for grasp in item.grasps]
    assert np.allclose([grasp.palm_distance for grasp in item.grasps], distances, rtol=1e-6)
    assert np.allclose(stored, distances, rtol=1e-6)
    assert (item.corner + 1e-6 >= item.points.max(axis=0)).all() and "Of the reach store" in type(item).corner.__doc__
assert "reach" in {stage for stage, _ in dataset.digests()}
assert {"corner", "palm_distance"} <= {*dataset.grasps()[0]}
assert export(dataset, folder + "/shared", "zarr") == len(dataset.grasps())
assert main(["validate", folder]) in (0, None)
"""


TABLE = '''

@products.table(stores=("touch",), category="Dataset")
def touches_of_classes(dataset):
    """Successful touches of each class."""
    counts = {name: dataset.of_class(name).array("touch", "success")[:].sum() for name in dataset.classes}
    return pd.DataFrame(counts.items(), columns=["class", "touches"])
'''


def test_a_new_table_is_one_function_and_a_new_stage_is_a_row_a_rule_and_a_script(finished, tmp_path):
    """The table of the text, of models, and one of the dataset. Nothing but the functions names them."""
    for name in COPIED:
        ignored = shutil.ignore_patterns("__pycache__", "images", "evidence", "results")
        shutil.copytree(PROJECT / name, tmp_path / name, symlinks=True, ignore=None if name == "palpate" else ignored)
    shutil.copyfile(PROJECT / "Snakefile", tmp_path / "Snakefile")
    folder = shutil.copytree(finished.run, tmp_path / "results" / finished.run.name)
    before = {path for path in tmp_path.rglob("*") if path.is_file()}

    def run(*arguments: str) -> str:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        command = [sys.executable, *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    (function,) = re.findall(r"```python\n(@products\.table.*?)```", CONTRIBUTING, re.DOTALL)
    own = "palpate/results/own.py"
    (tmp_path / own).write_text(f"import pandas as pd\n\nfrom palpate.results import products\n\n\n{function}{TABLE}")
    smoke = "--configfile", "config/smoke.yaml", "--config", "results=smoke"
    asked = "tables/worst_objects.csv", "all"
    planned = [run("-m", "snakemake", "--dry-run", "--cores", "1", target, *smoke) for target in asked]
    assert all(re.search(r"output: tables/worst_objects\.csv, .*\.md, .*\.tex", text) for text in planned)
    assert "evaluations/charts_occluded/seed-0.csv" in planned[0] and "tables/grasps.csv" not in planned[0]
    assert "tables/touches_of_classes.csv" in planned[1]

    for file, rows in {"stages.yaml": ROW, "store/contract.csv": ARRAYS}.items():
        with (tmp_path / "palpate" / file).open("a") as table:
            table.write(rows)
    (tmp_path / "workflow/rules/reach.smk").write_text(RULE)
    (tmp_path / "workflow/scripts/reach.py").write_text(SCRIPT)
    settings = "--configfile", str(finished.config), "--config", "results=results", "figures=false"
    run("-m", "snakemake", "--cores", "2", "dataset", *settings)
    made = pd.read_csv(folder / "tables/touches_of_classes.csv").set_index("class")["touches"]
    counted = palpate.Dataset(finished.run).table().groupby("class")["touches"].sum()
    assert made["can"] == counted["can"] > 0 and (folder / "tables/touches_of_classes.tex").exists()
    run("-c", READ, str(folder))
    files = {path.relative_to(tmp_path).as_posix() for path in {*tmp_path.rglob("*")} - before if path.is_file()}
    sources = {path for path in files if path.startswith(("palpate/", "workflow/")) and "__pycache__" not in path}
    assert sources == {own, "workflow/rules/reach.smk", "workflow/scripts/reach.py"}
    checked = (folder / "reports/validation.csv").read_text()
    assert re.search(r"^finite,reach,batch-0000,3,0\.0,0\.0,True,", checked, re.MULTILINE), checked
    shape = json.loads(next((folder / "shared").glob("*.zarr/corner/zarr.json")).read_text())["shape"]
    assert shape == [5, 3]  # an object a split
    run("workflow/schemas/document.py")
    assert "| reach | `palm_distance` | (o, g) | float32 | m |" in (tmp_path / "docs/dataset.md").read_text()
