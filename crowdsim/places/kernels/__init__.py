"""Compiled geometry of obstacles: distances, free ways, and the shortest way around."""
