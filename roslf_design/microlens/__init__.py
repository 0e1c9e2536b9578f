"""Microlens images: the shapes that the stops cut out, the array of microlenses, exact coverage of pixels and cells."""
