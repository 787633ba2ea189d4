"""Readers of mesh files, one a format, each a function `read(path, files)` that returns a `Loaded`.

A reader gives what the file's specification says it is, in triangles, with explicit materials. What it can't read is an
error that names it (ValueError), or, of a texture or another part without which the shape is the same, a problem noted
in `files`. Nothing is left out silently.
"""
