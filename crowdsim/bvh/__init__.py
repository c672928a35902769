"""BVH files: read, written, and turned into clips."""
