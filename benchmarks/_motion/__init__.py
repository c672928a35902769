"""Measures of motion inside the product: what ``motion_quality.py`` puts together."""
