"""Nominal models of the rigs, by how a model reaches its taps; `benchmarks.rigs.models` lists them all."""
