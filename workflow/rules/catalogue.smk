# Which objects the run has: class, split, batch, file, checksum; whole, and one file a batch.
rule catalogue:
    input:
        sources=lambda wildcards: source_inputs(ENTRIES),
    output:
        catalogue="catalogue.csv",
        batches=expand("catalogue/{batch}.csv", batch=BATCHES),
    log:
        "logs/catalogue.log",
    benchmark:
        "benchmarks/catalogue.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        source=SOURCE,
        classes=CLASS_COUNTS,
        split=config["split"],
        batch_size=config["batch_size"],
        schema=SCHEMAS / "catalogue.schema.yaml",
    script:
        "../scripts/catalogue.py"


# What could not be used, from all stages: object, stage, reason.
rule rejected:
    input:
        parts=expand("rejected/{stage}/{batch}.csv", stage=STAGES, batch=BATCHES),
    output:
        table="rejected.csv",
    log:
        "logs/rejected.log",
    benchmark:
        "benchmarks/rejected.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    script:
        "../scripts/rejected.py"
