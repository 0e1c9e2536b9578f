"""From raw images to the system's parameters and how sure we are of them.

White image -> microlens centres -> light field -> corners -> two-step calibration -> joint refinement -> posterior.
Modules here import scipy, OpenCV and emcee only inside the functions that need them (extra `calibrate`).
"""
