"""From recordings to binned samples with their noise, labels and signatures."""
