"""Scenarios in YAML: their keys, their checks, their reference."""
