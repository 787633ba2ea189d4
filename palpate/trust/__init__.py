"""What can be trusted: error against run time, stability on extreme cases, and what a scene leaves out.

Each of the three reports is made of parts (`studies`, `stability`, `left_out`: a module each), and a part
loads the engine of its own stage only.
"""
