"""What several packages use: type aliases, and small kernels."""
