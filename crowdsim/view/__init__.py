"""The player in a browser: recordings of runs and BVH files, the page that plays them, and the server of the page."""
