"""Crowds: drawn from a scenario and its policies, and run control frame by control frame.

``draw.draw_crowd`` draws a ``Crowd``: its ``Cast``, where avatars start, how they choose, and what is planned.
``model.build_model`` packs the policies into the arrays that kernels read. ``Simulation`` holds avatars in such arrays;
in every control frame those that are due observe, evaluate, choose, and all advance and are recorded in a ``Chunk``.
"""
