"""The diagnosis for people and programs: JSON, sentences, a page."""
