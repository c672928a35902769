"""Motion capture of others: its units, axes, joints and faults."""
