"""Cameras behind a real main lens: what the lens does to microlens images and to the field.

- `camera`: a design's lens with FAP, array and sensor; the backward ray from sensor point to scene, and its inverse
- `images`: microlens images, distortion, field curvature, colour, the measured non-distortion bound
- `microlens`: fields of one design or of many builds: image, pitch, light, stretch, chief rays in the scene
- `fields`: fields of a single design, with the detail that they show
- `train`: what rays meet in one build or many, rays aimed through it, their image points and spots
- `outlines`: shapes of microlens images, whole or cut

>>> from roslf_design.design import load
>>> from roslf_design.traced.images import real_field
>>> real_field(load("paper-singlet"), [(0.0, 0.0), (11.15, 0.0)]).images.diameter.round(4)
array([0.063 , 0.0743])
"""
