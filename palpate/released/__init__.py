"""The authors' released dataset: which objects it holds, and its arrays."""
