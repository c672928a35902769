"""What several packages use: type aliases, threads, and small kernels."""
