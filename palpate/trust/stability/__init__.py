"""Stiff and extreme cases: each module has `CASES`, a `palpate.trust.cases.Cases`."""
