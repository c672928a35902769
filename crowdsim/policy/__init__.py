"""The policy layer: environment grids, rewards, learning, and the trained bundle."""
