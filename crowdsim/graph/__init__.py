"""The graph layer: which frame may follow which, as states and actions."""
