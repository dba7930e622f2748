"""A recording by itself: curve parameters, loops and energy, quality flags, statistics over repeats."""
