"""The closed loop: diagnose, ask for the experiment that is worth most, measure, and go on."""
