"""Places: walls, boxes, discs, ropes and doors; distances from them, free ways, and ways around."""
