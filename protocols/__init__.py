"""Measurement protocols: units, the YAML schema, and the compiler to timed set-points. Imports nothing of ours."""
