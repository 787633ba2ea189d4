# One model of config/experiments.yaml, from just the stores that it takes arrays of (palpate/training/inputs.py).
rule reconstruction:
    input:
        unpack(experiment_stores),
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
        mem_mb=lambda wildcards, input: 4000 + 4 * stored_mb(input),
        runtime=1440,
        gpu=TRAINING_GPUS,
    params:
        experiment=lambda wildcards: EXPERIMENTS["experiments"][wildcards.experiment],
        settings=experiment_settings,
        machine=TRAINING_MACHINE,
        seed=lambda wildcards: int(wildcards.seed),
    script:
        "../scripts/train.py"
