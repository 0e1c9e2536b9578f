"""The report of a design: its pages, what is drawn in them, and comparisons of designs."""
