# Palpate: from CAD meshes to a visuo-tactile dataset, its tables and its figures.
# snakemake --cores 2 all makes the default run. Other targets, by name or file, are in README.md; `all`, `dataset`,
# `validate`, `reports` and `smoke` are rules.
import sys
from pathlib import Path

from snakemake.utils import min_version

min_version("9.0")

PROJECT = Path(workflow.basedir)
if workflow.current_basedir.get_path_or_uri(secret_free=True) != workflow.basedir:
    sys.exit(
        "Palpate is no module of another Snakemake workflow: run `snakemake` in Palpate's folder with a config of your"
        " own (--configfile), and give the other workflow the files of results/<run>"
    )
if {"{", "}"} & {*workflow.basedir}:
    sys.exit(f"{workflow.basedir}: Snakemake takes braces in a workflow's path for placeholders: rename the folder")

from workflow.run import environment, hooks

# At Ctrl-C the run ends its jobs (`hooks.catch_signals`). They ignore that of the terminal, where each would print.
shell.prefix("set -euo pipefail; trap '' INT; ")
hooks.prepare(PROJECT)


configfile: PROJECT / "config/config.yaml"


include: "workflow/rules/configuration.smk"
include: "workflow/rules/batches.smk"
include: "workflow/rules/experiments.smk"


report: "workflow/report/workflow.rst"


# Storage names the run's files by its prefix, and jobs elsewhere get the checkout that Snakemake is started in.
if not options.default_storage_provider:

    # Absolute, so that a cluster's jobs don't nest it, and so that `tables/x.csv` means the run's.
    workdir: RUN_FOLDER


# A file a stage, by its name, in the order of palpate/stages.yaml. Of a released dataset, which is read, those of models.
STAGE_RULES = [name for name, row in stages.STAGES.items() if not (RELEASED and (row.in_dataset or row.simulated))]
RESULTS = ["evaluation", "products", "results", "known_targets", "targets"]
for name in ["catalogue", "released" if RELEASED else "reports", "reconstruction", *STAGE_RULES, *RESULTS]:

    include: f"workflow/rules/{name}.smk"


if hooks.LogHandler.current:
    hooks.LogHandler.current.explain = explain_target


onstart:
    if warning := environment.warning(PROJECT / "envs/requirements.txt"):
        logger.warning(warning)
    hooks.end_at_signals()
    take_folder()
    hooks.catch_signals()


onsuccess:
    hooks.finish(RUN_FOLDER, object_pages=8)


onerror:
    hooks.finish(RUN_FOLDER, object_pages=0)


# Here, because Snakemake takes no default target from an included file.
rule all:
    default_target: True
    input:
        rules.dataset.input,
        [product_files(each) for each in MADE if each.category == "Models"],
