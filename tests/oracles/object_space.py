"""Rays through what stands before a main lens, surface by surface in mpmath: paraxial, or by Snell's law.

Shares no code with the package: every face is a refraction, every gap a straight line, a rod is steps of ray equations.
"""

import mpmath as mp


class Path:
    """A ray in one plane, from the main lens towards the scene: height and slope dx/dz, z towards the sensor."""

    def __init__(self, height, slope):
        self.x, self.slope, self.z, self.n = mp.mpf(height), mp.mpf(slope), mp.mpf(0), mp.mpf(1)

    def to(self, distance):
        """Straight on to a distance before the main lens."""
        self.x -= self.slope * (mp.mpf(distance) - self.z)
        self.z = mp.mpf(distance)
        return self.x

    def enter(self, index, exact):
        """Through a flat face into an index."""
        index = mp.mpf(index)
        if exact:
            sine = self.n / index * self.slope / mp.sqrt(1 + self.slope**2)
            self.slope = sine / mp.sqrt(1 - sine**2)
        else:
            self.slope *= self.n / index
        self.n = index

    def thin_lens(self, focal_length, decentre=0):
        """On the scene's side the slope that an ideal lens takes to the one on the sensor's."""
        self.slope += (self.x - mp.mpf(decentre)) / mp.mpf(focal_length)


def object_side(height, slope, elements, medium, planes, exact=False):
    """Heights of a ray at planes before the main lens, given behind it on the scene's side.

    Parameters
    ----------
    height, slope : number
        On the main lens and just before it.
    elements : list of (kind, distance, numbers...)
        From the lens outwards: ("plate", distance, thickness, index), ("lens", distance, focal length, decentre).
    medium : number
        Index in front of the last.
    planes : list of number
        Distances; none inside a plate.
    """
    heights = []
    for plane in planes:
        ray, last = Path(height, slope), mp.mpf(0)
        for number, (kind, distance, *numbers) in enumerate(elements):
            if distance >= plane:
                break
            ray.to(distance)
            if kind == "plate":
                thickness, index = numbers
                ray.enter(index, exact)
                last = mp.mpf(distance) + mp.mpf(thickness)
                ray.to(last)
                ray.enter(medium if number == len(elements) - 1 else 1, exact)
            else:
                ray.thin_lens(*numbers)
                last = mp.mpf(distance)
                if number == len(elements) - 1:
                    ray.slope /= mp.mpf(medium)
                    ray.n = mp.mpf(medium)
        heights.append(ray.to(plane))
    return heights
