"""tables/<table>.csv with .md and .tex, or figures/<figure>.png: by the function of palpate/results that declares it.

Each parameter of the function gets what `READERS` reads for it, or a value of params. Others keep their defaults.
"""

from workflow.run.job import log_to

from pathlib import Path

import palpate
from palpate import seal
from palpate.atomic import atomic_write
from palpate.experiments import Experiment
from palpate.results import products
from palpate.text_files import read_record

log_to(snakemake.log[0])
product, _ = products.find("tables" if snakemake.rule == "table" else "figures", snakemake.wildcards[0])

if product.kind == "tables" or {"evaluations", "rings", "selections", "touches"} & {*product.parameters}:
    from palpate.learning import rows  # loads pandas, which figures of the dataset don't need
    from palpate.results.tables import write_table

inputs, values = snakemake.input, snakemake.params.values


def frames():
    from palpate.results.dataset_tables import dataset_frames  # loads what tables of models don't need

    return dataset_frames(Path(inputs.catalogue).parent)


READERS = {
    "dataset": lambda: palpate.Dataset(Path(inputs.catalogue).parent, product.stores),
    "frames": frames,
    "evaluations": lambda: rows.read(inputs.evaluations),
    "rings": lambda: rows.read(inputs.rings, rows.RING_COLUMNS),
    "selections": lambda: rows.read(inputs.selections, rows.SELECTION_COLUMNS),
    "touches": lambda: rows.read([inputs.touches], rows.TOUCH_COLUMNS),
    "models": lambda: {Path(path).parents[1].name: path for path in inputs.models},
    "touch_depth": lambda: inputs.touch_depth,
    "trainings": lambda: [read_record(path) for path in inputs.trainings],
    "experiments": lambda: {name: Experiment.from_row(name, row) for name, row in values["experiments"].items()},
    "threads": lambda: snakemake.threads,
}
CONFIG = {"resamples": "evaluation.resamples", "samples": "vision.samples"}  # which parameters are values of the config
read = {name: READERS[name]() for name in product.parameters if name in READERS}
arguments = {name: values[name] for name in product.parameters if name in values} | read
made_from = seal.made_of(inputs, {CONFIG[name]: values[name] for name in CONFIG if name in arguments})
if product.kind == "tables":
    write_table(product.function(**arguments), snakemake.output.table, made_from)
else:
    with atomic_write(snakemake.output.figure, made_from) as path:
        product.function(path=path, **arguments)
