# Points around every object with their signed distances, for trainings of strategy `implicit`.
rule distances:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
    output:
        distances=directory("distances/{batch}.zarr"),
    log:
        "logs/distances/{batch}.log",
    benchmark:
        "benchmarks/distances/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        seed=config["seed"],
    script:
        "../scripts/distances.py"
