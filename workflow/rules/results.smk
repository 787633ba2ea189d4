# Tables as CSV, Markdown and LaTeX, the paper's values beside.
rule table:
    input:
        unpack(table_inputs),
    output:
        table=report(
            "tables/{table}.csv",
            caption="../../palpate/results/captions/tables.rst",
            category=lambda wildcards: "Dataset" if wildcards.table in DATASET_TABLES else "Models",
        ),
        text=["tables/{table}.md", "tables/{table}.tex"],
    log:
        "logs/{table}.log",
    benchmark:
        "benchmarks/{table}.tsv"
    wildcard_constraints:
        table="|".join(
            [
                *DATASET_TABLES,
                *EXPERIMENT_TABLES,
                "local_touch_charts",
                "claims",
                "touch_effect",
                "touch_effect_by_class",
                "surface_quality",
                "tuning",
                *ARCHITECTURES,
            ]
        ),
    params:
        settings=table_settings,
    script:
        "../scripts/table.py"


rule figure:
    input:
        unpack(figure_inputs),
    output:
        figure=report(
            "figures/{figure}.png",
            caption="../../palpate/results/captions/figures.rst",
            category=lambda wildcards: "Dataset" if wildcards.figure in DATASET_FIGURES else "Models",
        ),
    log:
        "logs/{figure}.log",
    benchmark:
        "benchmarks/{figure}.tsv"
    wildcard_constraints:
        figure="|".join(map(re.escape, [*DATASET_FIGURES, *MODEL_FIGURES, "multi_grasp", "error_over_rings"])),
    priority: 1  # Those of Blender take half a minute, which a run would wait for at its end.
    params:
        settings=figure_settings,
    script:
        "../scripts/figure.py"
