"""The sim-to-real diagnosis: where simulation and measurement differ, what causes it, how far it shrinks."""
