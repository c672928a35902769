"""The embedded performer: a parametric boxer whose motion ships with the package."""
