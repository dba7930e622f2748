"""The window's panels, one a file. A panel shows the messages it gets and emits a person's wishes as signals."""
