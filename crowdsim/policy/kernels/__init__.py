"""Compiled look-ups and rewards; ``environment.py``, ``rewards.py`` and ``policy.py`` define what they compute."""
