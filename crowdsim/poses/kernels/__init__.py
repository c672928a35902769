"""Compiled code of poses: where avatars are, blends, foot plants, strikes and reactions."""
