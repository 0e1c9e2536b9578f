"""A program from nothing to its first answer: RMS spot of one field through a biconvex singlet, printed as JSON.

Run as ``python first_answer.py PROGRAM``; each program does it as its own documentation would have it done.
"""

# mypy: allow-untyped-defs, allow-untyped-calls

import json
import sys

R, T, OBJECT, IMAGE, PUPIL, HEIGHT, WAVE_UM = 103.29, 7.0, 350.0, 136.0, 10.0, 28.0, 0.55


def here():
    import numpy as np

    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.prescription import Prescription, Surface
    from roslf_design.lenses.tracer import Rays

    lens = Prescription((Surface(1 / R, 15.0, T, find_glass("N-BK7")), Surface(-1 / R, 15.0)))
    rings = [ring / 6 * np.exp(2j * np.pi * np.arange(6 * ring) / (6 * ring)) for ring in range(1, 7)]
    points = PUPIL / 2 * np.concatenate([[0.0], *rings])
    pupil = np.stack([points.real, points.imag, 0 * points.real])
    rays = Rays.between(np.array([[0.0], [-HEIGHT], [-OBJECT]]), pupil)
    x, y, _ = lens.trace(rays, WAVE_UM * 1e-3, plane=T + IMAGE, clip=False).rays.position
    return float(np.sqrt(((x - x.mean()) ** 2 + (y - y.mean()) ** 2).mean()))


def optiland():
    from optiland.optic import Optic  # type: ignore[import-not-found]
    from optiland.optimization.operand.ray import RayOperand  # type: ignore[import-not-found]

    lens = Optic()
    lens.surfaces.add(index=0, thickness=OBJECT)
    lens.surfaces.add(index=1, radius=R, thickness=T, material="N-BK7", is_stop=True)
    lens.surfaces.add(index=2, radius=-R, thickness=IMAGE)
    lens.surfaces.add(index=3)
    lens.set_aperture(aperture_type="EPD", value=PUPIL)
    lens.fields.set_type(field_type="object_height")
    lens.fields.add(y=HEIGHT)
    lens.wavelengths.add(value=WAVE_UM, is_primary=True)
    return float(RayOperand.rms_spot_size(lens, -1, 0, 1, 6, WAVE_UM, "hexapolar"))


def batoid():
    import batoid as bt  # type: ignore[import-not-found]
    import numpy as np

    glass = [1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653]
    inside, air = bt.SellmeierMedium(glass), bt.ConstMedium(1.0)

    def at(z):
        return bt.CoordSys(origin=[0, 0, z])

    front = bt.RefractiveInterface(bt.Sphere(R), inMedium=air, outMedium=inside)
    back = bt.RefractiveInterface(bt.Sphere(-R), inMedium=inside, outMedium=air, coordSys=at(T))
    screen = bt.Detector(bt.Plane(), inMedium=air, outMedium=air, coordSys=at(T + IMAGE))
    lens = bt.CompoundOptic((front, back, screen), inMedium=air, outMedium=air)
    rings = [ring / 6 * np.exp(2j * np.pi * np.arange(6 * ring) / (6 * ring)) for ring in range(1, 7)]
    points = PUPIL / 2 * np.concatenate([[0.0], *rings])
    x, y, z = points.real, points.imag + HEIGHT, np.full(points.size, OBJECT)
    n, one = np.sqrt(x * x + y * y + z * z), np.ones(points.size)
    start = (0 * one, -HEIGHT * one, -OBJECT * one)
    rays = lens.trace(bt.RayVector(*start, x / n, y / n, z / n, 0 * one, WAVE_UM * 1e-6 * one, one))
    return float(np.sqrt(((rays.x - rays.x.mean()) ** 2 + (rays.y - rays.y.mean()) ** 2).mean()))


if __name__ == "__main__":
    print(json.dumps({"rms": {"here": here, "optiland": optiland, "batoid": batoid}[sys.argv[1]]()}))
