import pandas
from snakemake.utils import Paramspace

from palpate.training import tuning

TUNED = "charts_occluded_touch"
try:
    TUNING = Paramspace(
        pandas.DataFrame(
            tuning.grid(PROJECT / "config/tuning.yaml", config["tuning"]["grid"])
        )
    )
except ConfigError as error:
    raise WorkflowError(str(error)) from None


# One point of the supplement's grid of hyperparameters; not part of `all`.
use rule reconstruction as tuning_point with:
    input:
        unpack(lambda wildcards: stores_of(TUNED)),
    output:
        model=f"tuning/{TUNING.wildcard_pattern}/best.ckpt",
        history=f"tuning/{TUNING.wildcard_pattern}/history.csv",
        summary=f"tuning/{TUNING.wildcard_pattern}/training.json",
    log:
        f"logs/tuning/{TUNING.wildcard_pattern}.log",
    benchmark:
        f"benchmarks/tuning/{TUNING.wildcard_pattern}.tsv"
    params:
        experiment=EXPERIMENTS["experiments"].get(TUNED),
        settings=lambda wildcards: recipes.settings(
            RECIPE, EXPERIMENTS["experiments"][TUNED]
        ),
        point=TUNING.instance,
        steps=config["tuning"]["steps"],
        machine=TRAINING_MACHINE,
        seed=config["seed"],


rule tuning:
    input:
        points=expand("tuning/{point}/training.json", point=TUNING.instance_patterns),
    output:
        table=report(
            "tables/tuning.csv", caption="../report/tuning.rst", category="Models"
        ),
        text="tables/tuning.md",
        latex="tables/tuning.tex",
    log:
        "logs/tuning.log",
    benchmark:
        "benchmarks/tuning.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        points=TUNING.dataframe.to_dict("records"),
    script:
        "../scripts/tuning.py"
