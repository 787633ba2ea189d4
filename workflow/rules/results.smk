# Tables as CSV, Markdown and LaTeX, the paper's values beside.
rule table:
    input:
        unpack(product_inputs),
    output:
        table=report("tables/{table}.csv", caption="../report/product.rst", category=product_category),
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
        values=product_params,
        caption=caption,
    script:
        "../scripts/product.py"


use rule table as figure with:
    output:
        figure=report("figures/{figure}.png", caption="../report/product.rst", category=product_category),
    log:
        "logs/{figure}.log",
    benchmark:
        "benchmarks/{figure}.tsv"
    wildcard_constraints:
        figure="|".join(map(re.escape, product_names("figures", PRODUCTS))),
    priority: 1  # Those of Blender take some ten seconds, which a run would wait for at its end.


use rule figure as animation with:
    output:
        figure=report("figures/{figure}.gif", caption="../report/product.rst", category=product_category),
    wildcard_constraints:
        figure="|".join(map(re.escape, product_names("figures", PRODUCTS, "gif"))) or "none",
