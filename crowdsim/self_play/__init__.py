"""Sparring: what is learned in fights between avatars, with the control that runs them."""
