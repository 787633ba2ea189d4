"""Studies of the library: error against run time, stability, what is omitted; and benchmarks.

They compare it with references and naive variants; the library imports nothing of them. An item of a
report is a module, which loads the engine of its own stage only.
"""
