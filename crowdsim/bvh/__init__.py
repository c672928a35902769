"""BVH files: reading, writing and conversion to clips."""
