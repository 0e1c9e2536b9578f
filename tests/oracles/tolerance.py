"""One camera at a time, in plain vector geometry: rays followed plane by plane, shapes by rays around their rim.

Nothing here knows of homographies, conics, closed forms or batches; it shares only the design's numbers with the
library. Angles as in the design files: a part's normal is z turned by t_x about x, then by t_y about the fixed y.
"""

from __future__ import annotations

import numpy as np


def axes(tilt, roll=0.0):
    (tx, ty), r = tilt, roll
    about_x = np.array([[1, 0, 0], [0, np.cos(tx), -np.sin(tx)], [0, np.sin(tx), np.cos(tx)]])
    about_y = np.array([[np.cos(ty), 0, np.sin(ty)], [0, 1, 0], [-np.sin(ty), 0, np.cos(ty)]])
    about_z = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    return about_y @ about_x @ about_z


class Plane:
    """A part's plane: vertex, and axes as columns."""

    def __init__(self, decentre, z, tilt, roll=0.0):
        self.vertex = np.array([*decentre, z], float)
        self.axes = axes(tilt, roll)

    def point(self, x, y):
        return self.vertex + np.multiply.outer(x, self.axes[:, 0]) + np.multiply.outer(y, self.axes[:, 1])

    def meet(self, start, direction):
        normal = self.axes[:, 2]
        t = ((self.vertex - start) @ normal) / (direction @ normal)
        return start + t[..., None] * direction

    def local(self, point):
        inside = (point - self.vertex) @ self.axes
        return inside[..., 0], inside[..., 1]


class Camera:
    """The planes of one design."""

    def __init__(self, design):
        self.design = design
        d = design
        self.lens = Plane(d.main_lens.decentre, 0.0, d.main_lens.tilt)
        self.stops = [Plane(s.decentre, -s.distance, s.tilt) for s in d.all_stops]
        self.array = Plane(d.microlens_array.decentre, d.d_1, d.microlens_array.tilt, d.microlens_array.rotation)
        self.sensor = Plane(d.sensor.decentre, d.d_1 + d.d_2, d.sensor.tilt)
        self.radii = [s.diameter / 2 for s in d.all_stops]

    def bend(self, height, direction, sign):
        """Direction behind (+1, light's way) or before (-1) the ideal lens, through a point of its plane."""
        local = direction @ self.lens.axes
        slope = local[..., :2] / local[..., 2:]
        x, y = self.lens.local(height)
        slope = slope - sign * np.stack([x, y], -1) / self.design.f
        return np.concatenate([slope, np.ones_like(slope[..., :1])], -1) @ self.lens.axes.T

    def backward(self, p, q, c):
        """Sensor points (p, q) through the pinhole microlens at c: points on the lens plane, directions before it."""
        pixel, pinhole = self.sensor.point(p, q), self.array.point(*c)
        ray = pinhole - pixel
        height = self.lens.meet(np.broadcast_to(pinhole, pixel.shape), ray)
        return height, self.bend(height, ray, -1)

    def excess(self, p, q, c):
        """How far outside each opening (stops, then lens) a sensor point's ray passes [mm], shape (openings, ...)."""
        height, ray = self.backward(p, q, c)
        found = [np.hypot(*s.local(s.meet(height, ray))) - r for s, r in zip(self.stops, self.radii, strict=True)]
        return np.stack([*found, np.hypot(*self.lens.local(height)) - self.design.D / 2])

    def forward(self, start, through):
        """Object point through a point of object space: (microlens coordinates, sensor coordinates)."""
        height = self.lens.meet(start, through - start)
        ray = self.bend(height, height - start, +1)
        return self.array.local(self.array.meet(height, ray)), self.sensor.local(self.sensor.meet(height, ray))

    def rim_on_sensor(self, rim, c, count=64):
        """Where rays through points of a stop's rim and the microlens at c land, by Newton on the backward ray."""
        angle = 2 * np.pi * np.arange(count) / count
        return self.land(rim, self.radii[rim] * np.cos(angle), self.radii[rim] * np.sin(angle), c)

    def land(self, rim, a, b, c):
        """Sensor point whose backward ray through the microlens at c meets stop `rim` at (a, b)."""
        p, q = np.full_like(np.asarray(a, float), c[0]), np.full_like(np.asarray(a, float), c[1])
        stop = self.stops[rim]
        for _ in range(12):
            h = 1e-4
            here = np.array(stop.local(stop.meet(*self.backward(p, q, c))))
            dp = (np.array(stop.local(stop.meet(*self.backward(p + h, q, c)))) - here) / h
            dq = (np.array(stop.local(stop.meet(*self.backward(p, q + h, c)))) - here) / h
            off = here - np.array([a, b])
            det = dp[0] * dq[1] - dp[1] * dq[0]
            p, q = p - (off[0] * dq[1] - off[1] * dq[0]) / det, q - (dp[0] * off[1] - dp[1] * off[0]) / det
        return p, q


def enclosed(x, y):
    """Area inside a smooth closed curve given at evenly spaced parameters: trapezoidal, exact to rounding."""
    spectrum = np.fft.fft(x + 1j * y)
    index = np.fft.fftfreq(len(x), 1 / len(x))
    return np.pi * float((index * np.abs(spectrum / len(x)) ** 2).sum())


def evaluate_one(design, nominal, field, distance, rays=4096):
    """The metrics of one build at one microlens, as a dictionary."""
    camera, c = Camera(design), np.array(field, float)
    x, y = camera.rim_on_sensor(0, c)
    area = enclosed(x, y)
    diameter = 2 * np.sqrt(abs(area) / np.pi)
    chief = np.array(camera.land(0, 0.0, 0.0, c))
    halves = design.d / 2 * np.eye(2)
    steps = [np.subtract(camera.land(0, 0.0, 0.0, c + h), camera.land(0, 0.0, 0.0, c - h)) for h in halves]
    pitch = np.sqrt(abs(np.linalg.det(np.array(steps))))
    kept, ratio = shape(camera, c, x.mean(), y.mean(), abs(area), rays)
    return {
        "image_diameter_mm": diameter,
        "image_pitch_mm": pitch,
        "fill_factor": diameter / pitch,
        "mismatch_px": (diameter - pitch) / design.q,
        "kept_fraction": kept,
        "axis_ratio": ratio,
        **centre(camera, nominal, c, chief),
        "depth_error_mm": depth_error(camera, nominal, c, distance),
        "non_distortion_room_mm": room(camera, c, x, y),
    }


def shape(camera, c, x0, y0, whole, rays):
    """Kept fraction and axis ratio of the clipped image, by the distance to its edge in many directions."""
    inner = interior(camera, c, x0, y0, np.sqrt(whole / np.pi))
    if inner is None:
        return 0.0, np.nan
    x0, y0 = inner
    angle = 2 * np.pi * (np.arange(rays) + 0.5) / rays
    near, far = np.zeros(rays), np.full(rays, 4 * np.sqrt(whole / np.pi))
    for _ in range(34):
        middle = (near + far) / 2
        out = camera.excess(x0 + middle * np.cos(angle), y0 + middle * np.sin(angle), c).max(axis=0) > 0
        near, far = np.where(out, near, middle), np.where(out, middle, far)
    r, step = near, 2 * np.pi / rays
    area = (r**2 / 2).sum() * step
    mx, my = (r**3 / 3 * np.cos(angle)).sum() * step / area, (r**3 / 3 * np.sin(angle)).sum() * step / area
    xx = (r**4 / 4 * np.cos(angle) ** 2).sum() * step / area - mx * mx
    yy = (r**4 / 4 * np.sin(angle) ** 2).sum() * step / area - my * my
    xy = (r**4 / 4 * np.cos(angle) * np.sin(angle)).sum() * step / area - mx * my
    low, high = np.linalg.eigvalsh([[xx, xy], [xy, yy]])
    return area / whole, np.sqrt(low / high)


def interior(camera, c, x0, y0, radius):
    """The point of a grid over the pupil's image that lies deepest inside all openings; None if none is inside."""
    u = np.linspace(-1, 1, 41) * radius
    px, py = np.meshgrid(x0 + u, y0 + u)
    excess = camera.excess(px, py, c).max(axis=0)
    best = np.unravel_index(np.argmin(excess), excess.shape)
    return (px[best], py[best]) if excess[best] < 0 else None


def centre(camera, nominal, c, chief):
    """Where the image centre is against the nominal decoder's belief, and against the image of the lens's centre."""
    u = c / camera.design.d
    believed = u * nominal.d * (1 + nominal.d_2 * vergence(nominal)) / nominal.q
    error = chief / camera.design.q - believed
    pixel = camera.sensor.meet(camera.lens.vertex, camera.array.point(*c) - camera.lens.vertex)
    radius = np.hypot(*c)
    along = c / radius if radius > 0 else np.array([1.0, 0.0])
    shift = (np.array(camera.sensor.local(pixel)) - chief) @ along / camera.design.q
    return {
        "centre_error_x_px": error[0],
        "centre_error_y_px": error[1],
        "centre_error_px": np.hypot(*error),
        "centre_shift_px": shift,
    }


def vergence(design):
    """1/L by tracing: the chief ray's slope over its height at the array."""
    height = 1.0 * design.d_3
    slope = 1.0 - height / design.f
    return slope / (height + slope * design.d_1)


def depth_error(camera, nominal, c, distance):
    """Two rays from an object point through the pupil's ends; views and depth by the paper's Eqs. 2 and 12."""
    reference = Camera(nominal)
    chief = np.array(reference.land(0, 0.0, 0.0, c))
    height, ray = reference.backward(chief[0], chief[1], c)
    point = height + (-distance - height[2]) / ray[2] * ray
    radius = np.hypot(*c)
    along = c / radius if radius > 0 else np.array([1.0, 0.0])
    views, indices = [], []
    for sign in (1, -1):
        end = camera.stops[0].point(*(sign * camera.radii[0] * along))
        microlens, pixel = camera.forward(point, end)
        u = np.array(microlens) / camera.design.d
        believed = u * nominal.d * (1 + nominal.d_2 * vergence(nominal)) / nominal.q
        views.append((np.array(pixel) / camera.design.q - believed) @ along)
        indices.append(u @ along)
    slope = (indices[0] - indices[1]) / (views[0] - views[1])
    m = nominal.d_1 / nominal.d_f
    reach = m * (nominal.d_f - nominal.d_3)
    inverse = (m - slope * nominal.d * nominal.d_2 / (nominal.q * reach)) / reach
    return 1 / inverse + nominal.d_3 - distance


def room(camera, c, x, y):
    """Least distance of the pupil's edge rays from any other rim, inside positive; on a fine sampling of the edge."""
    excess = camera.excess(x, y, c)
    return float(-excess[1:].max())
