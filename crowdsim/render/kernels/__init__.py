"""Compiled drawing of capsules: projection, lists of cells, rays, light and colours."""
