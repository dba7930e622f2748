"""Instrument drivers: signals, transports, and per instrument a pure byte codec, a device class and its mathematics."""
