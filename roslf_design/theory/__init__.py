"""Closed forms of light-field imaging through a restricted object space, as functions of a `Camera`.

=================  ====================================================================================================
module             equations
=================  ====================================================================================================
exit_pupil         Eq. 4; exit pupil, pitch, diameter and shift of the microlens images
f_number           Eqs. 7-9, and Eqs. 7 and 8 solved for one length
vignetting         Eqs. 5-6, for any number of stops, decentred or not
stop_images        where each stop's image lies on the sensor, with every part decentred and tilted
object_space       exact rays through what stands before the main lens
chief_rays         where chief rays go in the scene, traced past elements
light_field        Eqs. 1, 2, 10 to 12; depth from disparity; Table 2: lengths from what a calibration finds
light              diffraction, microlens defocus, sampling
quantity           a number of a camera: name, unit, words, function, and where it is told
quantities         the registry: every number once
=================  ====================================================================================================

Eq. 3 and the lengths behind it (H, A, m, 1/L) are attributes of `Camera`. No number of a camera that can be built gives
NaN, and inf comes only where a docstring says so. Each result is within 4 ulp times (1 + its condition number, the sum
over its lengths of |x df/dx / f|) of the exact function of the floating-point lengths.
"""
