"""The page and pictures of an optimisation."""
