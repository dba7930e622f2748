"""The window's panels, one a file. A panel shows what it is told and says by signals what a person wants."""
