"""YAML files in, findings with line and column out."""
