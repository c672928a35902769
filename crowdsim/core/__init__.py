"""What every package may use: the lowest floor."""
