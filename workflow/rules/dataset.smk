localrules:
    dataset,


# The data and all that is told of them: nothing is trained.
rule dataset:
    input:
        STORES,
        [] if RELEASED else "reports/validation.csv",
        TABLES,
        FIGURES,
