"""Small kernels that several packages call: random numbers, rotations, geometry, tables."""
