"""What scenes leave out: each module has `leavings(run, subjects, settings)`."""
