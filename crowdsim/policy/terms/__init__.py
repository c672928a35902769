"""Reward terms, a file each: the keys of a recipe, and what they mean, compiled once for training, control and judging.

A term counts at the strikes of an action (``strike``), at each frame of its path (a pair ``at_frames`` of kernels,
such as those of ``proximity``), or once for an action, wherever the target is (``of_actions``, as ``transition``).
What goes through here: a recipe's terms become records (``registry.pack_terms``), and loops over frames, strikes and
targets in ``training.kernels.rewards``, ``crowd.kernels.rewards`` and ``policy.kernels.rewards`` call the kernels of
the terms.
"""
