"""Experiments not yet made: simulated sessions, plans, the next experiment."""
