"""Poses of a take: from what was recorded to joint rotations at any time.

``sampler`` is asked for avatars and times. ``poser`` cuts them into parts (``layer.Part``), each with a ``window`` of
the take, and lets layers add to their poses, one after the other in the order of ``layers.LAYERS``; where a layer reads
other avatars, it poses these first, with fewer layers the further away they are. ``kernels`` do the arithmetic.
"""
