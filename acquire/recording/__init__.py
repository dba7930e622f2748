"""Recordings: the journal written while running, the verified HDF5 file, reading, importing and exporting them."""
