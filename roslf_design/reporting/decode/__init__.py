"""The page and pictures of a decoded raw image."""
