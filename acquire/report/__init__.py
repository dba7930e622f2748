"""Recordings for people: a summary in words, figures, and self-contained HTML pages."""
