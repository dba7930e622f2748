"""Qualification of an instrument on reference specimens: the standard set, its measurement, and its result."""
