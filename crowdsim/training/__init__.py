"""What makes a policy: recipes, models, solvers, pruning, statistics."""
