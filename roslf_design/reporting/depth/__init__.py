"""Pages and pictures of measured depth."""
