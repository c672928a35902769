"""Compiled control: everything that avatars do in a control frame.

``model``, ``avatars``, ``world``, ``record``, ``scratch`` and ``strikes`` are the named tuples of ``crowd/arrays.py``.
Each kernel handles avatars (or decisions) ``first`` to ``last`` and writes nothing that another range reads in the same
stage. Look-ups and rewards mean what ``policy.kernels.values`` says, draws what ``random.uniform`` says; tests hold
them equal. Most kernels are inlined: passing arrays, of which a model has sixteen and scratch space as many, would take
longer than their work for a small crowd. All stages of a frame are one function in ``loop.run_frames``.
"""
