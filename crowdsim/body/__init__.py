"""A skinned body on any human skeleton.

A skeleton is brought into a binding pose (``binding``); muscles, bones and clothes are laid on it as rounded
cones and ellipsoids (``anatomy``); the skin of their smooth union (``field``) is meshed, thinned and cut at the borders
of its parts (``meshing``); each vertex is bound to at most four joints (``weights``). ``skin`` puts it together, once
per skeleton and build, and moves it with poses.
"""
