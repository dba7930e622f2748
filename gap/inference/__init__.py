"""Fits and their evidence; knows nothing of instruments or skin."""
