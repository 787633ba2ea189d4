FORMS = ("csv", "md", "tex")
# A released dataset has no views, which single images are taken from.
MODEL_TABLES = expand(
    "tables/{table}.{form}",
    table=[
        *(
            name
            for name in EXPERIMENTS["tables"]
            if not (RELEASED and sees_views(name))
        ),
        "local_touch_charts",
        *(["claims"] if claims_decidable() else []),
        *expand("architectures/{model}", model=ARCHITECTURES),
    ],
    form=FORMS,
)
TABLES += MODEL_TABLES


rule model_selection:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("model_selection")["experiments"]
        ),
    output:
        table=report(
            "tables/model_selection.csv",
            caption="../report/model_selection.rst",
            category="Models",
        ),
        text=["tables/model_selection.md", "tables/model_selection.tex"],
    log:
        "logs/model_selection.log",
    benchmark:
        "benchmarks/model_selection.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        setup=lambda wildcards: table_setup("model_selection"),
    script:
        "../scripts/model_selection.py"


rule input_modalities:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("input_modalities")["experiments"]
        ),
    output:
        table=report(
            "tables/input_modalities.csv",
            caption="../report/input_modalities.rst",
            category="Models",
        ),
        text=["tables/input_modalities.md", "tables/input_modalities.tex"],
    log:
        "logs/input_modalities.log",
    benchmark:
        "benchmarks/input_modalities.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        setup=lambda wildcards: table_setup("input_modalities"),
    script:
        "../scripts/input_modalities.py"


# Its file is tables/grasps.csv; rule grasps makes the grasps themselves.
rule grasps_table:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("grasps")["experiments"]
        ),
    output:
        table=report(
            "tables/grasps.csv",
            caption="../report/grasps.rst",
            category="Models",
        ),
        text=["tables/grasps.md", "tables/grasps.tex"],
    log:
        "logs/grasps_table.log",
    benchmark:
        "benchmarks/grasps_table.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        setup=lambda wildcards: table_setup("grasps"),
    script:
        "../scripts/grasps_table.py"


rule extrapolation:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("extrapolation")["experiments"], "evaluations/rings"
        ),
    output:
        table=report(
            "tables/extrapolation.csv",
            caption="../report/extrapolation.rst",
            category="Models",
        ),
        text=["tables/extrapolation.md", "tables/extrapolation.tex"],
    log:
        "logs/extrapolation.log",
    benchmark:
        "benchmarks/extrapolation.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        setup=lambda wildcards: table_setup("extrapolation"),
    script:
        "../scripts/extrapolation.py"


rule single_image:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("single_image")["experiments"]
        ),
    output:
        table=report(
            "tables/single_image.csv",
            caption="../report/single_image.rst",
            category="Models",
        ),
        text=["tables/single_image.md", "tables/single_image.tex"],
    log:
        "logs/single_image.log",
    benchmark:
        "benchmarks/single_image.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        setup=lambda wildcards: table_setup("single_image"),
    script:
        "../scripts/single_image.py"


rule local_touch_charts:
    input:
        touches="evaluations/touch_depth.csv",
    output:
        table=report(
            "tables/local_touch_charts.csv",
            caption="../report/local_touch_charts.rst",
            category="Models",
        ),
        text=["tables/local_touch_charts.md", "tables/local_touch_charts.tex"],
    log:
        "logs/local_touch_charts.log",
    benchmark:
        "benchmarks/local_touch_charts.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        split="test",
        resamples=config["evaluation"]["bootstrap"],
    script:
        "../scripts/local_touch_charts.py"


rule claims:
    input:
        evaluations=lambda wildcards: evaluations_of(published_experiments()),
        rings=lambda wildcards: evaluations_of(
            published_experiments("extrapolation"), "evaluations/rings"
        ),
        touches="evaluations/touch_depth.csv",
    output:
        table=report(
            "tables/claims.csv",
            caption="../report/claims.rst",
            category="Models",
        ),
        text=["tables/claims.md", "tables/claims.tex"],
    log:
        "logs/claims.log",
    benchmark:
        "benchmarks/claims.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        resamples=config["evaluation"]["bootstrap"],
    script:
        "../scripts/claims.py"


# Read off the modules themselves, beside the paper's rows; no data are needed.
rule architectures:
    output:
        tables=report(
            expand("tables/architectures/{model}.csv", model=ARCHITECTURES),
            caption="../report/architectures.rst",
            category="Architectures",
        ),
        text=expand(
            "tables/architectures/{model}.{form}",
            model=ARCHITECTURES,
            form=FORMS[1:],
        ),
    log:
        "logs/architectures.log",
    benchmark:
        "benchmarks/architectures.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=10,
    script:
        "../scripts/architectures.py"
