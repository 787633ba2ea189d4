import sys


localrules:
    smoke,


# A run of its own (config/smoke.yaml, results/smoke/), whatever the config of this one.
rule smoke:
    log:
        "logs/smoke.log",
    conda:
        CONDA
    threads: 2
    params:
        project=PROJECT,
        python=sys.executable,
        config=PROJECT / "config/smoke.yaml",
    shell:
        "log=$(realpath {log:q}); cd {params.project:q};"
        " {params.python:q} -m snakemake --cores {threads} all validate --configfile {params.config:q}"
        ' 2>&1 | tee "$log"'
