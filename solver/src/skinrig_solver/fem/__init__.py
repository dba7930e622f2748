"""Two-dimensional finite elements for nearly incompressible bodies: axisymmetric or plane strain."""
