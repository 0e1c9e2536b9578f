"""Real main lenses: what they are, and exact rays through them.

- `glass`, `prescription`, `lens_file`: media, lenses as drawn, their first order; lens files, the lenses that ship
- `tracer`: exact rays, builds times rays, either way, each with what became of it
- `manufacture`: what the making of a lens can miss, by name; a lens as made, and many builds at once

>>> from roslf_design.lenses.lens_file import load_lens
>>> from roslf_design.lenses.prescription import first_order
>>> round(first_order(load_lens("LA1050-A"), 550e-6).focal_length, 2)
99.32
"""
