"""The crowd layer: scenarios and their simulation."""
