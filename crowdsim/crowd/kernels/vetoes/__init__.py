"""What is said against an action once it has been drawn, a file each.

``choose`` lists them. A veto is a kernel ``veto(model, avatars, world, now, own, observed, q, action)``, which returns
by how much the action should be worth less, 0 where it has nothing against it; then the avatar draws again.
"""
