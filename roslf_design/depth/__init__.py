"""Depth from decoded light fields, and the files that hold them."""
