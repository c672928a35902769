"""Many runs: axes multiplied out, done by the workers of a Dask scheduler, and reported together."""
