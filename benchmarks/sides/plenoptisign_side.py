"""PlenoptiSign's part: geometry of a plenoptic camera. Called as its documentation says."""

# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np
import plenoptisign  # type: ignore[import-not-found]


def geometry(inputs, options):
    """Refocusing distance at shift 1, baseline of neighbouring views, entrance pupil, design by design.

    Its exit-pupil distance counts from the array and its object distance from the array to the focal plane.
    """
    cases = []
    for f, d_f, d_3, d, d_2, q in zip(*(inputs[name] for name in ("f", "d_f", "d_3", "d", "d_2", "q")), strict=True):
        d_1 = f * d_f / (d_f - f)
        pupil = d_1 - f * d_3 / (d_3 - f)
        lens = {"fU": f, "HH": 0.0, "df": d_f + d_1, "dA": pupil, "D": 2.9, "f_num": f / 2.9}
        array = {"pp": q, "fs": d_2, "hh": 0.0, "pm": d, "sd": (14.9, 22.3)}
        asked = {"a": 1.0, "M": 13.0, "G": 1, "dx": 1}
        values = {**lens, **array, **asked}
        cases.append({k: v if isinstance(v, (int, tuple)) else float(v) for k, v in values.items()})
    state = {}

    def run():
        rows = []
        for case in cases:
            camera = plenoptisign.MainClass(dict(case))
            camera.refo()
            camera.tria()
            found = camera.get_results()
            rows.append((found[0], found[4], vars(camera)["_intersect"]))
        state["rows"] = rows

    def result():
        refocus, baseline, pupil = np.array(state["rows"], float).T
        return {"refocus": refocus, "baseline": np.abs(baseline), "entrance_pupil": pupil}

    return run, result


WORK = {"geometry": geometry}
