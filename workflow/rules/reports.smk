# Error against run time, stability on extreme cases, what is omitted. Made on demand, by `snakemake reports`, on some
# objects of the run. What each item reads stands in studies/items.py.
localrules:
    reports,


rule report_item:
    input:
        unpack(report_inputs),
    output:
        table="reports/{report}/{item}.csv",
    log:
        "logs/reports/{report}-{item}.log",
    benchmark:
        "benchmarks/reports/{report}-{item}.tsv"
    wildcard_constraints:
        report="|".join(report_items.REPORTS),
    # It works on one thread.
    threads: lambda wildcards: (workflow.resource_settings.cores or 1) if timed(wildcards) else 1
    resources:
        mem_mb=6000,
        runtime=120,
    params:
        settings=report_settings,
        batches=REPORT_BATCHES,
        objects=lambda wildcards: config["reports"]["objects"] if timed(wildcards) else 1,
        rounds=lambda wildcards: config["reports"]["rounds"] if timed(wildcards) else 1,
    script:
        "../scripts/report_item.py"


rule report:
    input:
        tables=lambda wildcards: report_tables(wildcards.report),
    output:
        table=report(
            "reports/{report}.csv",
            caption="../../palpate/results/captions/reports.rst",
            category="Reports",
        ),
        text="reports/{report}.md",
        figure=report(
            "reports/{report}.png",
            caption="../../palpate/results/captions/reports.rst",
            category="Reports",
        ),
    log:
        "logs/{report}.log",
    benchmark:
        "benchmarks/{report}.tsv"
    wildcard_constraints:
        report="|".join(report_items.REPORTS),
    script:
        "../scripts/report.py"


rule reports:
    input:
        [
            f"reports/{report}.{form}"
            for report in report_items.REPORTS
            if report_tables(report)
            for form in ("csv", "md", "png")
        ],
