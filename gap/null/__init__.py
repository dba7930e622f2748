"""The simulation without an effect: instruments, and skin under any law."""
