"""Designs that pictures and reports are tried on: the presets, and what is difficult."""

from roslf_design.design import Design, load, preset_names


def strange(**changes):
    """A design with further stops, decentres and strong vignetting."""
    data = load("paper").model_dump()
    data["stops"] = [
        {"diameter": 10.0, "distance": 60.0, "decentre": (0.8, 0.0)},
        {"diameter": 14.0, "distance": 200.0, "decentre": (0.0, 0.5), "tilt": (0.02, 0.0)},
    ]
    data["aperture"]["decentre"] = (-0.3, 0.2)
    data["microlens_array"]["layout"] = "hexagonal"
    return Design.make({**data, **changes})


PAPER = load("paper")
UNLIKE = ("paper", "paper-singlet", "cystoscope", "grin-needle", "arthroscope")
"""Presets that differ in what laws of them all may hang on: ideal lens, real lens, a bore of elements, a thin one,
a folded axis."""
DESIGNS = {name: load(name) for name in preset_names()}
DESIGNS["vignetted"] = PAPER.replace(D=12.0)
DESIGNS["at the lens"] = PAPER.replace(d_3=0.0)
DESIGNS["strange"] = strange()
EXTREMES = {
    "dark": PAPER.replace(D=20.0, d_3=180.0),
    "stops and decentres": PAPER.replace(
        {"stops": ({"diameter": 8.0, "distance": 60.0, "decentre": (0.5, -0.3)},
                   {"diameter": 20.0, "distance": 20.0}),
         "main_lens.decentre": (0.4, 0.1), "sensor.decentre": (0.2, 0.3), "microlens_array.rotation": 0.01}
    ),
    "hexagonal": PAPER.replace({"microlens_array.layout": "hexagonal", "microlens_array.lens_shape": "circular"}),
    "tilted": PAPER.replace({"main_lens.tilt": (0.01, 0.0)}),
    "nearly at the focal plane": PAPER.replace(d_3=349.0),
    "far": PAPER.replace(d_f=1e6),
    "all but at the focal plane": PAPER.replace(d_3=350 * (1 - 1e-10)),
    "a thousandfold overlap": PAPER.replace(D_F=40.0, d_2=30.0, d=0.02),
    "pixels by the million": PAPER.replace(q=1e-5),
}  # fmt: skip
WATER = {"index": 1.333, "abbe": 55.8}
THROUGH = {
    "window in water": PAPER.replace(
        {"elements": [{"kind": "plate", "distance": 122.0, "thickness": 1.0, "material": "N-BK7", "diameter": 8.0}],
         "object_space.medium": WATER}
    ),
    "relay": PAPER.replace(
        {"elements": [{"kind": "lens", "distance": 400.0, "focal_length": 40.0, "diameter": 30.0},
                      {"kind": "lens", "distance": 480.0, "focal_length": 40.0, "diameter": 30.0}],
         "aperture.distance": 500.0, "aperture.diameter": 0.3, "main_lens.focal_plane": 540.0,
         "sensor.size": (6.0, 4.0), "microlens_array.size": (6.5, 4.5)}
    ),
    "objective": PAPER.replace(
        {"elements": [{"kind": "lens", "distance": 400.0, "focal_length": 30.0, "diameter": 36.0}],
         "aperture.distance": 428.0, "aperture.diameter": 0.5, "main_lens.focal_plane": 445.0,
         "sensor.size": (6.0, 4.0), "microlens_array.size": (6.5, 4.5)}
    ),
    "needle": load("rigid-scope").replace(
        {"elements": [{"kind": "grin", "distance": 1.0, "thickness": 31.4, "index": 1.6, "gradient": 0.2,
                       "diameter": 2.7},
                      {"kind": "plate", "distance": 32.6, "thickness": 0.3, "material": "N-BK7", "diameter": 2.6}],
         "main_lens.focal_plane": 45.0, "object_space.medium": WATER}
    ),
    "prism and cover": PAPER.replace(
        {"elements": [{"kind": "prism", "distance": 20.0, "thickness": 60.0, "material": "N-BK7", "diameter": 40.0,
                       "deviation": 0.52},
                      {"kind": "lens", "distance": 90.0, "focal_length": -300.0, "decentre": (0.6, 0.0)},
                      {"kind": "prescription", "distance": 100.0, "prescription": "LA1050-A"}],
         "main_lens.focal_plane": 180.0,
         "sensor.cover": {"thickness": 0.4, "material": "N-BK7"},
         "microlens_array.substrate": {"thickness": 1.2, "material": {"index": 1.46}}}
    ),
}  # fmt: skip
"""What looks through something else than air."""
