"""Fails, naming them, if a check in reports/validation.csv failed, or if no object could be used."""

import sys

import pandas as pd

from palpate.batch import log_to

log_to(snakemake.log[0])
checks = pd.read_csv(snakemake.input.table)
failed = checks[~checks.passed]
if len(failed):
    sys.exit(f"{len(failed)} of {len(checks)} checks failed:\n{failed.to_string(index=False)}")

catalogue, rejected = pd.read_csv(snakemake.input.catalogue), pd.read_csv(snakemake.input.rejected)
if set(catalogue.object) <= set(rejected.object):
    sys.exit(f"none of {len(catalogue)} objects could be used; the first: {rejected.reason[0]}")
