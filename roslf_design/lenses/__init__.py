"""Real main lenses: prescriptions, glasses, exact rays through them, and what they do to a light-field camera.

>>> from roslf_design.lenses import load_lens, first_order
>>> lens = load_lens("LA1050-A")
>>> first_order(lens, 550e-6).focal_length
"""

from __future__ import annotations
