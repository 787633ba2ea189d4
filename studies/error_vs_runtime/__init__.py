"""The stages' studies of error against run time: each module has `study(run, subjects, settings)`."""
