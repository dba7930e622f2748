"""The operator's window: nothing else imports Qt, and nothing in the window's process hosts an engine."""
