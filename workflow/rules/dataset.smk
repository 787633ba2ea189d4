localrules:
    dataset,


# The stores that everything else is made from.
rule dataset:
    input:
        "catalogue.csv",
        "rejected.csv",
        expand("surface/{batch}.zarr", batch=BATCHES),
        expand("grasps/{batch}.h5", batch=[] if RELEASED else BATCHES),
        expand("touch/{batch}.zarr", batch=BATCHES),
        expand("vision/{batch}.zarr", batch=BATCHES),
