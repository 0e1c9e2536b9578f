"""What one would write by hand in plain numpy and scipy: a floor for the comparisons."""

# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code="var-annotated"

import numpy as np

BLOCK = 4096
"""Rays done at once, so that temporaries stay in cache."""


def singlet(inputs, options):
    """Sphere and plane, whole blocks."""
    radius, thickness, behind = (float(inputs[name]) for name in ("radius", "thickness", "behind"))
    semi, n_glass = float(inputs["D"]) / 2, float(inputs["index"])
    c, mu = 1 / radius, 1 / n_glass
    whole = tuple(inputs[name] for name in ("x", "y", "s", "t"))
    count = whole[0].size
    kept, end_x, end_y = np.empty(count, bool), np.empty(count), np.empty(count)

    def run():
        for begin in range(0, count, BLOCK):
            part = slice(begin, begin + BLOCK)
            x, y, s, t = (values[part] for values in whole)
            dz = 1 / np.sqrt(1 + s * s + t * t)
            dx, dy = s * dz, t * dz
            x, y = x + 20.0 * s, y + 20.0 * t
            b, e = dz - c * (x * dx + y * dy), c * (x * x + y * y)
            root = np.sqrt(b * b - c * e)
            step = e / (b + root)
            x, y, z = x + step * dx, y + step * dy, step * dz
            good = x * x + y * y <= semi * semi
            bend = np.sqrt(1 - mu * mu * (1 - root * root)) - mu * root
            dx, dy, dz = mu * dx - bend * c * x, mu * dy - bend * c * y, mu * dz + bend * (1 - c * z)
            step = (thickness - z) / dz
            x, y = x + step * dx, y + step * dy
            kept[part] = good & (x * x + y * y <= semi * semi)
            dx, dy = n_glass * dx, n_glass * dy
            dz = np.sqrt(1 - dx * dx - dy * dy)
            end_x[part], end_y[part] = x + behind / dz * dx, y + behind / dz * dy

    def result():
        return {"kept": kept, "x": end_x, "y": end_y}

    return run, result


def centres(inputs, options):
    """Threshold at half the light, label, centre of mass weighted by brightness."""
    from scipy import ndimage

    image, state = inputs["image"], {}

    def run():
        labels, count = ndimage.label(image > image.max() / 2)
        found = ndimage.center_of_mass(np.maximum(image, 0), labels, np.arange(1, count + 1))
        state["found"] = np.array(found)[:, ::-1]

    def result():
        return {"centres": state["found"]}

    return run, result


def write(inputs, options):
    """Nothing but writing an image: a new array filled with one value, by as many threads as allowed."""
    from concurrent.futures import ThreadPoolExecutor

    rows, columns = (int(size) for size in options["shape"])
    threads, state = int(options["threads"]), {}
    pool = ThreadPoolExecutor(threads)

    def fill(image, k):
        image[rows * k // threads : rows * (k + 1) // threads].fill(1.0)

    def run():
        state["image"] = None
        image = np.empty((rows, columns), np.float32)
        list(pool.map(fill, [image] * threads, range(threads)))
        state["image"] = image

    def result():
        image = state["image"]
        return {"shape": image.shape, "mean": image.mean(), "dtype_bytes": image.dtype.itemsize}

    return run, result


WORK = {"singlet": singlet, "centres": centres, "write": write}
