"""The page and pictures of a tolerance study."""
