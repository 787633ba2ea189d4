# Tables as CSV, Markdown and LaTeX, the paper's values beside.
rule table:
    input:
        unpack(lambda wildcards: product_inputs("tables", wildcards.table)),
    output:
        table=report(
            "tables/{table}.csv",
            caption="../report/product.rst",
            category=lambda wildcards: products.find("tables", wildcards.table)[0].category,
        ),
        text=["tables/{table}.md", "tables/{table}.tex"],
    log:
        "logs/{table}.log",
    benchmark:
        "benchmarks/{table}.tsv"
    wildcard_constraints:
        table="|".join(map(re.escape, product_names("tables", PRODUCTS))),
    conda:
        "../../envs/palpate.yaml"
    params:
        values=lambda wildcards: product_params("tables", wildcards.table),
        caption=lambda wildcards, output: caption("tables", wildcards.table),
    script:
        "../scripts/product.py"


rule figure:
    input:
        unpack(lambda wildcards: product_inputs("figures", wildcards.figure)),
    output:
        figure=report(
            "figures/{figure}.png",
            caption="../report/product.rst",
            category=lambda wildcards: products.find("figures", wildcards.figure)[0].category,
        ),
    log:
        "logs/{figure}.log",
    benchmark:
        "benchmarks/{figure}.tsv"
    wildcard_constraints:
        figure="|".join(map(re.escape, product_names("figures", PRODUCTS))),
    priority: 1  # Those of Blender take half a minute, which a run would wait for at its end.
    conda:
        "../../envs/palpate.yaml"
    params:
        values=lambda wildcards: product_params("figures", wildcards.figure),
        caption=lambda wildcards, output: caption("figures", wildcards.figure),
    script:
        "../scripts/product.py"
