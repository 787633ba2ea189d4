# The atlas on the surface of every object, for trainings of strategy `template`.
rule templates:
    input:
        surface="surface/{batch}.zarr",
    output:
        templates=directory("templates/{batch}.zarr"),
    log:
        "logs/templates/{batch}.log",
    benchmark:
        "benchmarks/templates/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        seed=config["seed"],
    script:
        "../scripts/templates.py"
