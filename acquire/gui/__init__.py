"""The operator's window. Nothing outside this package imports Qt, and nothing in the window's process hosts an engine."""
