"""Fails, with the names, if a check in reports/validation.csv failed or no object could be used."""

import sys

import pandas as pd

from palpate.batch import log_to, read_rejections
from palpate.catalogue import read_catalogue

log_to(snakemake.log[0])
checks = pd.read_csv(snakemake.input.table)
failed = checks[~checks.passed]
if len(failed):
    sys.exit(f"{len(failed)} of {len(checks)} checks failed:\n{failed.to_string(index=False)}")

catalogue, rejected = read_catalogue(snakemake.input.catalogue), read_rejections([snakemake.input.rejected])
if {entry.object for entry in catalogue} <= {rejection.object for rejection in rejected}:
    sys.exit(f"none of {len(catalogue)} objects could be used; the first: {rejected[0].reason}")
