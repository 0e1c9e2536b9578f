"""Real main lenses: what they are, exact rays through them, and what they do to a light-field camera.

- `glass`, `prescription`, `perturb`: media, surfaces, lenses as drawn and as made
- `lens_file`, `zmx`: lens files in and out; the lenses that ship
- `trace`: exact rays either way, each with what became of it
- `first_order`: focal length, principal planes, pupils, focus
- `camera`: a lens with FAP, array and sensor; the backward ray from sensor point to scene
- `images`, `fields`: microlens images, distortion, field curvature, colour, the measured non-distortion bound
- `surrogate`: a fast polynomial twin with a stated error
- `of_design`: the camera of a design file, its images against the thin twin
- `manufacture`: what the making of a lens can miss, by name
- `builds`, `aim`: many builds of a lens at once, their images and spots from exact rays

>>> from roslf_design.lenses.camera import mounted
>>> from roslf_design.lenses.images import real_images
>>> from roslf_design.lenses.lens_file import load_lens
>>> camera = mounted(load_lens("LB1630-A"), 550e-6, pupil_diameter=2.9, pupil_distance=120, sensor_distance=2,
...                  focal_plane=350)
>>> real_images(camera, [[0.0, 0.0], [11.15, 0.0]]).diameter.round(4)
array([0.0637, 0.0713])
"""

from __future__ import annotations
