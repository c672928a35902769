"""From a scenario to a crowd that is ready for its first frame, in a run, in Python or in a profile."""
