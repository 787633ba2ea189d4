TABLES = expand(
    "tables/{table}.{form}",
    table=["dataset_statistics", "grasp_success"]
    + ([] if RELEASED else ["penetration"]),
    form=["csv", "md", "tex"],
)


# Counted from the touch stores and the catalogue alone: no renderer starts for a table.
rule tables:
    input:
        catalogue="catalogue.csv",
        rejected=expand(
            "rejected/{stage}/{batch}.csv",
            stage=[stage for stage in STAGES if stage != "vision"],
            batch=BATCHES,
        ),
        touch=expand("touch/{batch}.zarr", batch=BATCHES),
        grasps=expand("grasps/{batch}.h5", batch=[] if RELEASED else BATCHES),
    output:
        statistics=report(
            "tables/dataset_statistics.csv",
            caption="../report/dataset_statistics.rst",
            category="Dataset",
        ),
        statistics_text=[
            "tables/dataset_statistics.md",
            "tables/dataset_statistics.tex",
        ],
        success=report(
            "tables/grasp_success.csv",
            caption="../report/grasp_success.rst",
            category="Dataset",
        ),
        success_text=["tables/grasp_success.md", "tables/grasp_success.tex"],
        penetration=(
            []
            if RELEASED
            else report(
                "tables/penetration.csv",
                caption="../report/penetration.rst",
                category="Dataset",
            )
        ),
        penetration_text=(
            [] if RELEASED else ["tables/penetration.md", "tables/penetration.tex"]
        ),
    log:
        "logs/tables.log",
    benchmark:
        "benchmarks/tables.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    script:
        "../scripts/tables.py"
