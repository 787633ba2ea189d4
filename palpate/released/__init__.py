"""The authors' released dataset: which objects it holds, its arrays read and written."""
