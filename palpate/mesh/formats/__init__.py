"""Readers of mesh files, one a format: `read(path, files)` returns a `Loaded`, as the specification says the file is.
What can't be read is an error that names it (ValueError), or, without which the shape is the same, noted in `files`."""
