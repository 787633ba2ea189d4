"""Studies of the library: error against run time, stability, what is omitted; and benchmarks.

They compare the library with references and naive variants; the library imports nothing of them. Each item of a
report is a module that loads the engine of its own stage only.
"""
