"""The data sheet: its lines and what is drawn on it."""
