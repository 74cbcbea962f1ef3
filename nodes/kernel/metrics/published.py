"""Makes the tables of published.rs again from pictures in a folder, with public tools.

Write the pictures with
    LIGHTLOOM_PAIRS=folder cargo test -p lightloom-nodes --release -- --ignored writes_the_pairs
then, with numpy, scikit-image and OpenImageIO installed,
    python nodes/kernel/metrics/published.py folder
"""

import pathlib
import sys

import numpy as np

NAMES = ["noise", "blur", "shift", "hdr", "dark"]


def read_pfm(path):
    """A colour PFM as [height, width, 3] of 32-bit floats, first row at the top."""
    kind, size, scale, data = path.read_bytes().split(b"\n", 3)
    assert kind == b"PF", path
    width, height = map(int, size.split())
    order = "<f4" if float(scale) < 0 else ">f4"
    rows = np.frombuffer(data, order).reshape(height, width, 3)
    return np.ascontiguousarray(rows[::-1], dtype=np.float32)


def srgb(light):
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def with_numpy(test, reference):
    """The formulas, written with numpy in doubles."""
    i, r = test.astype(np.float64), reference.astype(np.float64)
    error = (i - r) ** 2
    peak = np.percentile(np.abs(r), 99)
    shown = np.mean((srgb(i / peak) - srgb(r / peak)) ** 2)
    yield "rmse", np.sqrt(error.mean())
    yield "rel_mse", np.mean(error / (r**2 + 1e-2))
    yield "error99", np.percentile(np.abs(i - r), 99)
    yield "psnr", -10 * np.log10(shown)
    yield "psnr_linear", 10 * np.log10(peak**2 / error.mean())


def with_scikit_image(test, reference):
    """Structural similarity of Rec. 709 luma of sRGB values."""
    from skimage.metrics import structural_similarity

    luma = [
        srgb(image.astype(np.float64)) @ [0.2126, 0.7152, 0.0722] for image in (test, reference)
    ]
    options = dict(gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1)
    yield "ssim", structural_similarity(*luma, **options)


def with_openimageio(test, reference):
    """How many pixels differ: what `idiff -p` counts, and the same at another view."""
    import OpenImageIO as oiio

    def buffer(image):
        height, width, channels = image.shape
        pixels = oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))
        pixels.set_pixels(pixels.roi, image)
        return pixels

    for name, luminance, fov in [("different", 100, 45), ("different_near", 300, 10)]:
        result = oiio.CompareResults()
        oiio.ImageBufAlgo.compare_Yee(buffer(test), buffer(reference), result, luminance, fov)
        yield name, result.nfail


TOOLS = [with_numpy, with_scikit_image, with_openimageio]


def main(folder):
    for name in NAMES:
        test, reference = (
            read_pfm(folder / f"{name}.{part}.pfm") for part in ("test", "reference")
        )
        for tool in TOOLS:
            for metric, value in tool(test, reference):
                print(f'    ("{name}", "{metric}", {float(value)!r}),')


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
