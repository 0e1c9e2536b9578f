"""Pictures of a design as SVG text, each made in milliseconds: values in, text out, nothing drawn elsewhere.

All take a theme ("light" or "dark") and a size in pixels, at which text is at least 11 px high.
"""
