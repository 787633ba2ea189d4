TABLES = expand(
    "tables/{table}.{form}",
    table=["dataset_statistics", "grasp_success"],
    form=["csv", "md"],
)


# Counted from the touch stores and the catalogue alone: no renderer starts for a table.
rule tables:
    input:
        catalogue="catalogue.csv",
        rejected="rejected.csv",
        touch=expand("touch/{batch}.zarr", batch=BATCHES),
        grasps=expand("grasps/{batch}.h5", batch=BATCHES),
    output:
        statistics=report(
            "tables/dataset_statistics.csv",
            caption="../report/dataset_statistics.rst",
            category="Dataset",
        ),
        statistics_text="tables/dataset_statistics.md",
        success=report(
            "tables/grasp_success.csv",
            caption="../report/grasp_success.rst",
            category="Dataset",
        ),
        success_text="tables/grasp_success.md",
    log:
        "logs/tables.log",
    benchmark:
        "benchmarks/tables.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    script:
        "../scripts/tables.py"
