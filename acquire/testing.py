"""The pytest plugin of a lab's own tests: fixtures that start simulated instruments (entry point ``pytest11``)."""
