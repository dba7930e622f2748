"""Simulated instruments: their physics stage by stage, effects that can be switched on, byte-level servers, faults."""
