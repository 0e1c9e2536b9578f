"""Raw light-field images from a design, a scene and a plan of effects."""
