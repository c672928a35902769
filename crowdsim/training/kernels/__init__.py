"""Compiled training: the model, sweeps of the solvers, judging actions, and episodes."""
