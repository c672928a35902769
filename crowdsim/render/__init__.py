"""The render layer: pictures and video from a take."""
