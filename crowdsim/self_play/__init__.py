"""Sparring: what is learned in fights between avatars, and how well a policy fights, by the control that runs them."""
