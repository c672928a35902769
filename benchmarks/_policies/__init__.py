"""Measures of policies against the paper: what ``policy_quality.py`` and ``paper.py`` put together."""
