# Error against run time, stability on extreme cases, what is omitted. Made on demand, by `snakemake reports`, on some
# objects of the run. What each item reads stands in studies/items.py.
from studies import items as report_items
from studies.subjects import round_robin

REPORT_OBJECTS = round_robin(ENTRIES, lambda entry: entry.class_name)[: config["reports"]["objects"]]
REPORT_BATCHES = sorted({PLACES[entry.object] for entry in REPORT_OBJECTS})


def report_item(wildcards):
    return report_items.REPORTS[wildcards.report][wildcards.item]


def report_inputs(wildcards):
    """What an item reads, of the batches that hold the report's objects."""
    files = {name: report_items.FILES[name] for name in report_item(wildcards).reads}
    files["catalogue"] = "catalogue/{batch}.csv"
    return {name: expand(paths, batch=REPORT_BATCHES, every_batch=BATCHES) for name, paths in sorted(files.items())}


def report_settings(wildcards):
    """The sections of the config that an item depends on."""
    return {section: RECIPE if section == "recipe" else config[section] for section in report_item(wildcards).settings}


def report_tables(report):
    """The tables of the items that `reports.stages` asks for."""
    asked = report_items.items_of_stages(report, config["reports"]["stages"])
    return expand(f"reports/{report}/{{item}}.csv", item=asked)


def timed(wildcards):
    """Whether an item measures times: then no other job runs beside it."""
    return wildcards.report in report_items.TIMED


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
            caption="../report/product.rst",
            category="Reports",
        ),
        text="reports/{report}.md",
        figure=report(
            "reports/{report}.png",
            caption="../report/product.rst",
            category="Reports",
        ),
    log:
        "logs/{report}.log",
    benchmark:
        "benchmarks/{report}.tsv"
    wildcard_constraints:
        report="|".join(report_items.REPORTS),
    params:
        caption=lambda wildcards, output: caption("reports", wildcards.report),
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
