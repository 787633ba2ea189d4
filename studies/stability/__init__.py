"""Stiff and extreme cases: each module has `CASES`, a `studies.stability.cases.Cases`."""
