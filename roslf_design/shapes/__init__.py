"""Shapes on the sensor: common parts of discs and ellipses, cells, exact pixel coverage, lattices."""
