localrules:
    validate,


# Every array of every store against the dataset contract.
rule validate_batch:
    input:
        meshes="meshes/{batch}",
        catalogue="catalogue.csv",
        surface="surface/{batch}.zarr",
        grasps="grasps/{batch}.h5",
        touch="touch/{batch}.zarr",
        vision="vision/{batch}.zarr",
        rejected=expand("rejected/{stage}/{{batch}}.csv", stage=STAGES),
    output:
        table="reports/validation/{batch}.csv",
    log:
        "logs/validate_batch/{batch}.log",
    benchmark:
        "benchmarks/validate_batch/{batch}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        max_penetration=config["grasps"]["max_penetration"],
    script:
        "../scripts/validate_batch.py"


rule validation:
    input:
        catalogue="catalogue.csv",
        rejected="rejected.csv",
        batches=expand("reports/validation/{batch}.csv", batch=BATCHES),
    output:
        table=report(
            "reports/validation.csv",
            caption="../report/validation.rst",
            category="Dataset",
        ),
    log:
        "logs/validation.log",
    benchmark:
        "benchmarks/validation.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    script:
        "../scripts/validation.py"


# A target that fails if a check failed or nothing could be used; the report stays, to be read.
rule validate:
    input:
        table="reports/validation.csv",
        catalogue="catalogue.csv",
        rejected="rejected.csv",
    log:
        "logs/validate.log",
    conda:
        CONDA
    script:
        "../scripts/validate.py"
