"""Measures of fights: what ``fights.py`` puts together."""
