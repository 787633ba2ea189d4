# Error against run time, stability on extreme cases, what is omitted. Made on demand, by `snakemake reports`, on some
# objects of the run. What each item reads stands in studies/items.py.
from studies import items as report_items
from studies.subjects import round_robin

REPORT_OBJECTS = round_robin(ENTRIES, lambda entry: entry.class_name)[: config["reports"]["objects"]]
REPORT_BATCHES = sorted({PLACES[entry.object] for entry in REPORT_OBJECTS})
ASKED_ITEMS = {each: report_items.items_of_stages(each, config["reports"]["stages"]) for each in report_items.REPORTS}
REPORT_TABLES = {each: expand(f"reports/{each}/{{item}}.csv", item=items) for each, items in ASKED_ITEMS.items()}
REPORT_FILES = {
    name: expand(paths, batch=REPORT_BATCHES, every_batch=BATCHES)
    for name, paths in {**report_items.FILES, "catalogue": "catalogue/{batch}.csv"}.items()
}
item_of = lambda wildcards: report_items.REPORTS[wildcards.report][wildcards.item]
# Whether an item measures times: then no other job runs beside it.
is_timed = lambda wildcards: wildcards.report in report_items.TIMED


rule report_item:
    input:
        unpack(lambda wildcards: {name: REPORT_FILES[name] for name in ("catalogue", *item_of(wildcards).reads)}),
    output:
        table="reports/{report}/{item}.csv",
    log:
        "logs/reports/{report}-{item}.log",
    benchmark:
        "benchmarks/reports/{report}-{item}.tsv"
    wildcard_constraints:
        report="|".join(report_items.REPORTS),
    conda:
        "../../envs/palpate.yaml"
    # It works on one thread.
    threads: lambda wildcards: all_cores() if is_timed(wildcards) else 1
    resources:
        mem_mb=6000,
        runtime=120,
    params:
        settings=lambda wildcards: {
            section: RECIPE.row() if section == "recipe" else config[section]
            for section in item_of(wildcards).settings
        },
        batches=REPORT_BATCHES,
        objects=lambda wildcards: config["reports"]["objects"] if is_timed(wildcards) else 1,
        rounds=lambda wildcards: config["reports"]["rounds"] if is_timed(wildcards) else 1,
    script:
        "../scripts/report_item.py"


rule report:
    input:
        tables=lambda wildcards: REPORT_TABLES[wildcards.report],
    output:
        table=report("reports/{report}.csv", caption="../report/product.rst", category="Reports"),
        text="reports/{report}.md",
        figure=report("reports/{report}.png", caption="../report/product.rst", category="Reports"),
    log:
        "logs/{report}.log",
    benchmark:
        "benchmarks/{report}.tsv"
    wildcard_constraints:
        report="|".join(report_items.REPORTS),
    conda:
        "../../envs/palpate.yaml"
    params:
        caption=lambda wildcards, output: caption(wildcards, output),
    script:
        "../scripts/report.py"


rule reports:
    input:
        [f"reports/{name}.{form}" for name, tables in REPORT_TABLES.items() if tables for form in ("csv", "md", "png")],
