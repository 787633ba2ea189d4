# The embedded source: procedural CAD objects, written as files that are then read like anyone's.
rule shapes:
    output:
        folder=directory("sources/{class}"),
    log:
        "logs/shapes/{class}.log",
    benchmark:
        "benchmarks/shapes/{class}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        name=lambda wildcards: wildcards["class"],
        objects=lambda wildcards: CLASS_COUNTS[wildcards["class"]],
        seed=config["seed"],
    script:
        "../scripts/shapes.py"
