"""From fitted explanations to a verdict."""
