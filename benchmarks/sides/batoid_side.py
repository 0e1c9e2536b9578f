"""batoid's part: rays through the singlet, in its C++ engine. It has no ideal lens."""

# mypy: allow-untyped-defs, allow-untyped-calls

import batoid  # type: ignore[import-not-found]
import numpy as np

N_BK7 = [1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653]
"""Sellmeier coefficients of the glass as SCHOTT gives them."""


def singlet(inputs, options):
    """Ready-made rays through the singlet to a plane behind it; lengths in mm, wavelengths in m as batoid wants."""
    thickness, behind, semi = float(inputs["thickness"]), float(inputs["behind"]), float(inputs["D"]) / 2
    glass, air = batoid.SellmeierMedium(N_BK7), batoid.ConstMedium(1.0)
    rim = batoid.ObscNegation(batoid.ObscCircle(semi))
    front = batoid.RefractiveInterface(
        batoid.Sphere(float(inputs["radius"])), name="front", inMedium=air, outMedium=glass, obscuration=rim
    )
    back = batoid.RefractiveInterface(
        batoid.Plane(),
        name="back",
        inMedium=glass,
        outMedium=air,
        obscuration=rim,
        coordSys=batoid.CoordSys(origin=[0, 0, thickness]),
    )
    screen = batoid.Detector(
        batoid.Plane(),
        name="screen",
        inMedium=air,
        outMedium=air,
        coordSys=batoid.CoordSys(origin=[0, 0, thickness + behind]),
    )
    lens = batoid.CompoundOptic((front, back, screen), inMedium=air, outMedium=air)
    x, y, s, t = (np.array(inputs[name], np.float64) for name in ("x", "y", "s", "t"))
    n = 1 / np.sqrt(1 + s * s + t * t)
    wave, flux, zero = np.full(x.size, float(inputs["wavelength_um"]) * 1e-6), np.ones(x.size), np.zeros(x.size)
    z, state = np.full(x.size, -20.0), {}

    def run():
        rays = batoid.RayVector(x, y, z, s * n, t * n, n, zero, wave, flux)
        state["rays"] = lens.trace(rays)

    def result():
        rays = state["rays"]
        return {"kept": ~(rays.vignetted | rays.failed), "x": rays.x, "y": rays.y}

    return run, result


WORK = {"singlet": singlet}
