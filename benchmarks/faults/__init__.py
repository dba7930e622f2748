"""The fault campaign: faults of many kinds, seeded, against the simulator in a process of its own; see `__main__`."""
