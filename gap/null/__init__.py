"""The simulation without an effect: instruments, and what skin may do under any law."""
