"""PlenoptiCam's part: microlens centres of a white image, by its documented calibration classes."""

# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np
from plenopticam.cfg import PlenopticamConfig  # type: ignore[import-not-found]
from plenopticam.lfp_calibrator import (  # type: ignore[import-not-found]
    CentroidExtractor,
    CentroidRefiner,
    CentroidSorter,
    GridFitter,
    PitchEstimator,
)
from plenopticam.misc import PlenopticamStatus  # type: ignore[import-not-found]


def centres(inputs, options):
    """Pitch, extraction, refinement by `method`, sorting, grid fit; grey levels from 0 to 255 as of a picture."""
    image = np.clip(np.asarray(inputs["image"], np.float64), 0, None)
    image, state = image / image.max() * 255, {}

    def run():
        state["found"] = np.empty((0, 2))
        config, status = PlenopticamConfig(), PlenopticamStatus()
        config.params.update(opt_prnt=False, cal_meth=options["method"])
        pitch = PitchEstimator(image, config, status)
        pitch.main()
        peaks = CentroidExtractor(image, config, status, pitch.M)
        peaks.main()
        fine = CentroidRefiner(image, peaks.centroids, config, status, pitch.M, method=options["method"])
        fine.main()
        lattice = CentroidSorter(fine.centroids_refined, config, status)
        lattice.main()
        if len(lattice.mic_list):
            grid = GridFitter(coords_list=lattice.mic_list, cfg=config, sta=status)
            grid.main()
            state["found"] = np.asarray(grid.grid_fit, float)[:, 1::-1]

    def result():
        return {"centres": state["found"]}

    return run, result


WORK = {"centres": centres}
