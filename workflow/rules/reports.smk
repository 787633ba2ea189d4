# What can be trusted: error against run time, stability on extreme cases, what scenes leave out. Made on demand, by
# `snakemake reports`, on some objects of the run. Jobs that take times have the machine for themselves.
localrules:
    reports,


# Error against run time of one stage.
rule study:
    input:
        unpack(report_inputs("error_vs_runtime")),
    output:
        table="reports/error_vs_runtime/{part}.csv",
    log:
        "logs/reports/error_vs_runtime-{part}.log",
    benchmark:
        "benchmarks/reports/error_vs_runtime-{part}.tsv"
    conda:
        CONDA
    threads: whole_machine()
    resources:
        mem_mb=6000,
        runtime=120,
    params:
        settings=report_settings("error_vs_runtime"),
        batches=REPORT_BATCHES,
        objects=config["reports"]["objects"],
        rounds=config["reports"]["rounds"],
    script:
        "../scripts/study.py"


rule error_vs_runtime:
    input:
        parts=report_parts("error_vs_runtime"),
    output:
        table=report(
            "reports/error_vs_runtime.csv",
            caption="../report/error_vs_runtime.rst",
            category="Reports",
        ),
        text="reports/error_vs_runtime.md",
        figure=report(
            "reports/error_vs_runtime.png",
            caption="../report/error_vs_runtime.rst",
            category="Reports",
        ),
    log:
        "logs/error_vs_runtime.log",
    benchmark:
        "benchmarks/error_vs_runtime.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    script:
        "../scripts/error_vs_runtime.py"


# Stiff and extreme cases of one kind.
rule extreme_cases:
    input:
        unpack(report_inputs("stability")),
    output:
        table="reports/stability/{part}.csv",
    log:
        "logs/reports/stability-{part}.log",
    benchmark:
        "benchmarks/reports/stability-{part}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=6000,
        runtime=60,
    params:
        batches=REPORT_BATCHES,
    script:
        "../scripts/extreme_cases.py"


rule stability:
    input:
        parts=report_parts("stability"),
    output:
        table=report(
            "reports/stability.csv",
            caption="../report/stability.rst",
            category="Reports",
        ),
        text="reports/stability.md",
        figure=report(
            "reports/stability.png",
            caption="../report/stability.rst",
            category="Reports",
        ),
    log:
        "logs/stability.log",
    benchmark:
        "benchmarks/stability.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    script:
        "../scripts/stability.py"


# What the scenes of one stage leave out.
rule leavings:
    input:
        unpack(report_inputs("left_out")),
    output:
        table="reports/left_out/{part}.csv",
    log:
        "logs/reports/left_out-{part}.log",
    benchmark:
        "benchmarks/reports/left_out-{part}.tsv"
    conda:
        CONDA
    threads: whole_machine()
    resources:
        mem_mb=6000,
        runtime=60,
    params:
        settings=report_settings("left_out"),
        batches=REPORT_BATCHES,
        objects=config["reports"]["objects"],
        rounds=config["reports"]["rounds"],
    script:
        "../scripts/leavings.py"


rule left_out:
    input:
        parts=report_parts("left_out"),
    output:
        table=report(
            "reports/left_out.csv",
            caption="../report/left_out.rst",
            category="Reports",
        ),
        text="reports/left_out.md",
        figure=report(
            "reports/left_out.png",
            caption="../report/left_out.rst",
            category="Reports",
        ),
    log:
        "logs/left_out.log",
    benchmark:
        "benchmarks/left_out.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    script:
        "../scripts/left_out.py"


rule reports:
    input:
        [f"reports/{name}.{form}" for name, parts in REPORT_STAGES.items() if parts for form in ("csv", "md", "png")],
