# Square rings of surface points around every successful touch (section 5.3).
rule rings:
    input:
        touch="touch/{batch}.zarr",
        # Of a source without meshes the surface points stand in for them.
        meshes=[] if RELEASED else "meshes/{batch}",
        surface="surface/{batch}.zarr" if RELEASED else [],
    output:
        rings=directory("rings/{batch}.zarr"),
    log:
        "logs/rings/{batch}.log",
    benchmark:
        "benchmarks/rings/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        seed=config["seed"],
    script:
        "../scripts/rings.py"
