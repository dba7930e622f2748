"""The core: run engine, safety, recording, import and export, analysis, command line and window."""
