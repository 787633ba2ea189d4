localrules:
    export,


# The dataset in the layout that the authors released theirs in, for their code; with sheets if charts were made.
rule export_released:
    input:
        STORES,
    output:
        folder=directory("released"),
    log:
        "logs/export.log",
    benchmark:
        "benchmarks/export.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    script:
        "../scripts/export.py"


rule export:
    input:
        rules.export_released.output,
