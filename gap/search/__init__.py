"""Which effects are worth a fit: linear screening, starting points, refits, pairs."""
