"""The take layer: the recorded run and the poses that follow from it."""
