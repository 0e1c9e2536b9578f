"""Relay scopes of any proportions, and where they are in focus by ray matrices in 40 digits."""

import mpmath as mp
from hypothesis import strategies as st

import roslf_design as roslf

GLASS, WATER = 1.76, 1.333


@st.composite
def relay_scopes(draw):
    """A head that sees a plane ahead of the tip at infinity: objective, relay, ocular, all ideal, behind a window."""

    def number(least, most):
        return draw(st.floats(least, most))

    f, ocular, relay = number(15, 80), number(8, 30), number(8, 25)
    objective, working, window = number(0.6, 3), number(4, 40), number(0.2, 1)
    medium = draw(st.sampled_from([1.0, WATER]))
    working += 12 * objective  # well beyond the objective's focus
    ahead = working / medium + window / GLASS + 0.2
    at_ocular = number(5, 20)
    image = at_ocular + ocular
    stop = image + 2 * relay
    at_objective = image + 4 * relay + objective * ahead / (ahead - objective)
    lenses = [(at_ocular, ocular), (image + relay, relay), (image + 3 * relay, relay), (at_objective, objective)]
    elements = [
        {"kind": "lens", "distance": place, "focal_length": power, "diameter": 6.0} for place, power in lenses
    ] + [
        {"kind": "plate", "distance": at_objective + 0.2, "thickness": window, "material": {"index": GLASS},
         "diameter": 6.0},
    ]  # fmt: skip
    places = {
        "elements": elements, "aperture.diameter": f * relay / ocular / 30, "aperture.distance": stop,
        "object_space.medium": {"index": medium}, "microlens_array.size": [0.05 * f, 0.04 * f], "tube": None,
        "sensor.size": [0.04 * f, 0.03 * f],
    }  # fmt: skip
    return roslf.load("cystoscope").replace(places, f=f, d_1=f)


def in_focus(design, d_1):
    """Distance before the main lens at which rays from a point of the array meet again, by matrices; and whether they
    run together as they leave the foremost lens."""
    with mp.workdps(40):
        # Height and reduced slope of a ray from the array's middle, outwards.
        height, slope, here = mp.mpf(d_1), mp.mpf(1), mp.mpf(0)
        slope -= height / mp.mpf(design.f)
        for part in sorted(design.elements, key=lambda element: element.distance):
            height += (mp.mpf(part.distance) - here) * slope
            here = mp.mpf(part.distance) + mp.mpf(part.length)
            if part.kind == "lens":
                slope -= height / mp.mpf(part.focal_length)
                together = height * slope < 0
            else:
                height += mp.mpf(part.thickness) / mp.mpf(float(part.material.index(design.wavelength))) * slope
        medium = mp.mpf(float(design.object_space.medium.index(design.wavelength)))
        return here - medium * height / slope, together
