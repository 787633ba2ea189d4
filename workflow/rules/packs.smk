# What a family of experiments is trained and measured on, in one file; made of just the stores that it sees.
rule pack:
    input:
        unpack(pack_stores),
        catalogue="catalogue.csv",
    output:
        pack="packs/{family}.h5",
    log:
        "logs/pack/{family}.log",
    benchmark:
        "benchmarks/pack/{family}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=60,
    script:
        "../scripts/pack.py"
