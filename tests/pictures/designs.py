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
