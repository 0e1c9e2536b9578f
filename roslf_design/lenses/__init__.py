"""Real main lenses: what they are, exact rays through them, and what they do to a light-field camera.

- `glass`, `prescription`, `lens_file`: media, lenses as drawn, their first order; lens files, the lenses that ship
- `tracer`: exact rays, builds times rays, either way, each with what became of it
- `manufacture`: what the making of a lens can miss, by name; a lens as made, and many builds at once
- `camera`: a design's lens with FAP, array and sensor; the backward ray from sensor point to scene, and its inverse
- `images`: microlens images, distortion, field curvature, colour, the measured non-distortion bound
- `aim`, `outlines`: image points, spots and image shapes of many builds
- `surrogate`: a fast polynomial twin with a stated error

>>> from roslf_design.design import load
>>> from roslf_design.lenses.images import real_field
>>> real_field(load("paper-singlet"), [(0.0, 0.0), (11.15, 0.0)]).images.diameter.round(4)
array([0.063 , 0.0743])
"""
