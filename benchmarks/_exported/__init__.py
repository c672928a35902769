"""Measures of exported BVH files and clouds, read without the package: what ``exported.py`` puts together."""
