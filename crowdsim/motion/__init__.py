"""The motion layer: clips in, one motion database out."""
