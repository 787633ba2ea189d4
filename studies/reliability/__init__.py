"""Faults of disks, copies and clocks, applied to a copy of a run: is anything lost or read wrong without a word?"""
