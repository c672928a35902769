"""What an action is worth, term by term, a file each.

``evaluate`` lists them. A term is a kernel ``term(model, avatars, world, now, own, observed, q, scratch)``, which adds
to ``scratch.values[q]`` what it finds each action of the avatar in slot ``own`` to be worth. ``q`` is the avatar's
place among those that decide together, along which observations run. A term writes nothing that other avatars read.
"""
