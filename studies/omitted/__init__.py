"""What is omitted: each module has `omissions(run, subjects, settings)`, which yields `omission.Omission`s."""
