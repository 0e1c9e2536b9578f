"""Lit parts of microlens images by brute force: thousands of spokes, each halved to the last ray that comes through."""

import numpy as np

from roslf_design.traced.camera import views

HALVINGS = 50


def lit_part(camera, microlens, points=3072):
    """Area [mm^2], axis ratio, and seen part of the FAP of the image behind one microlens (2,); 0 where dark.

    The boundary's polygon on the FAP is too small by 7 over the square of its points; all else is of that order.
    """

    def room(p):
        at = views(camera, microlens, p, clip=False)
        return np.minimum(at.fap_margin, at.margin)

    size = 0.6 * camera.lens.clear_diameter * abs(camera.d_2 / camera.d_1)
    hub, step = microlens * (1 + camera.d_2 / camera.d_1), size
    side = np.stack(np.meshgrid(*[np.linspace(-1, 1, 65)] * 2), axis=-1).reshape(-1, 2)
    for _ in range(6):  # where there is most room
        trial = hub + step * side
        hub, step = trial[np.argmax(room(trial))], step / 8
    if not room(hub) > 0:
        return 0.0, 0.0, 0.0
    turn = 2 * np.pi * np.arange(points) / points
    way = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    low, high = np.zeros(points), np.full(points, 4 * size)
    for _ in range(HALVINGS):
        half = (low + high) / 2
        inside = room(hub + half[:, None] * way) >= 0
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    x, y = low[:, None].T * way.T
    width = 2 * np.pi / points
    area = np.sum(low**2) / 2 * width
    mx, my = np.sum(low**2 * x) / 3 * width / area, np.sum(low**2 * y) / 3 * width / area
    xx, xy, yy = (np.sum(low**2 * part) / 4 * width / area for part in (x * x, x * y, y * y))
    low_axis, high_axis = np.linalg.eigvalsh([[xx - mx * mx, xy - mx * my], [xy - mx * my, yy - my * my]])
    u, v = views(camera, microlens, hub + low[:, None] * way, clip=False).pupil.T
    u, v = u - u.mean(), v - v.mean()
    fap = abs(np.sum(u * np.roll(v, -1) - v * np.roll(u, -1))) / 2
    return area, np.sqrt(low_axis / high_axis), fap / camera.fap.opening.area
