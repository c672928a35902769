"""The export layer: BVH and point clouds from a take."""
