from palpate.training import families, recipes


def experiment_pack(wildcards):
    """The pack of the experiment's family; a run with too few grasps for it is an error before anything runs."""
    experiment = EXPERIMENTS["experiments"][wildcards.experiment]
    if experiment["grasps"] > config["grasps"]["per_object"]:
        raise WorkflowError(
            f"experiment {wildcards.experiment} sees {experiment['grasps']} grasps, but the config's "
            f"grasps.per_object is {config['grasps']['per_object']}: raise it"
        )
    return f"packs/{families.family(experiment)}.h5"


wildcard_constraints:
    experiment="|".join(EXPERIMENTS["experiments"]),
    seed=r"\d+",


# One model of config/experiments.yaml.
rule reconstruction:
    input:
        pack=experiment_pack,
    output:
        model="models/{experiment}/seed-{seed}/best.ckpt",
        history="models/{experiment}/seed-{seed}/history.csv",
        summary="models/{experiment}/seed-{seed}/training.json",
    log:
        "logs/reconstruction/{experiment}-{seed}.log",
    benchmark:
        "benchmarks/reconstruction/{experiment}-{seed}.tsv"
    conda:
        CONDA
    threads: config["training"]["threads"]
    resources:
        mem_mb=lambda wildcards, input: 4000 + 4 * input.size_mb,
        runtime=1440,
        gpu=TRAINING_GPUS,
    params:
        experiment=lambda wildcards: EXPERIMENTS["experiments"][wildcards.experiment],
        settings=lambda wildcards: recipes.settings(
            RECIPE, EXPERIMENTS["experiments"][wildcards.experiment]
        ),
        machine=TRAINING_MACHINE,
    script:
        "../scripts/reconstruction.py"
