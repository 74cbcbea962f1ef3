"""Makes the values of published_flip.rs with the published tools, from the pairs as PFM files.

python3 published_flip.py FOLDER, with `pip install numpy flip-evaluator==1.7 cvvdp==0.5.7`.
The pairs come from the test `writes_the_pairs`: FOLDER holds NAME.test.pfm and NAME.reference.pfm,
linear Rec. 709 RGB.
"""

import pathlib
import sys

import flip_evaluator
import numpy
import pycvvdp

DISPLAYS = ["standard_4k", "standard_fhd", "standard_hdr_linear"]


def picture(path):
    with open(path, "rb") as file:
        if file.readline().strip() != b"PF":
            raise ValueError(f"{path} is no colour PFM file")
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        rows = numpy.frombuffer(file.read(), order).reshape(height, width, 3)
    return numpy.ascontiguousarray(rows[::-1], dtype=numpy.float32)


def encoded(linear):
    """sRGB from 0 to 1, unrounded."""
    linear = numpy.clip(linear.astype(numpy.float64), 0, 1)
    curve = 1.055 * linear ** (1 / 2.4) - 0.055
    return numpy.where(linear <= 0.0031308, 12.92 * linear, curve).astype(numpy.float32)


def flip(test, reference, dynamic_range):
    _, mean, _ = flip_evaluator.evaluate(
        reference, test, dynamic_range, inputsRGB=False, applyMagma=False
    )
    return mean


def displayed(linear, display):
    """What the display is sent for linear 1 to be its white: sRGB, or cd/m2."""
    if display != "standard_hdr_linear":
        return encoded(linear)
    peak, contrast = 1500, 1e6
    return (peak / contrast + (peak - peak / contrast) * numpy.clip(linear, 0, 1)).astype(numpy.float32)


def jod(test, reference, display, frames_per_second=0):
    """A video where there is a rate, else an image."""
    metric = pycvvdp.cvvdp(display_name=display, quiet=True)
    quality, _ = metric.predict(
        displayed(test, display),
        displayed(reference, display),
        dim_order="FHWC" if frames_per_second else "HWC",
        frames_per_second=frames_per_second,
    )
    return quality.item()


def main(folder):
    names = sorted(path.name[: -len(".test.pfm")] for path in folder.glob("*.test.pfm"))
    pairs = {
        name: [picture(folder / f"{name}.{role}.pfm") for role in ("test", "reference")]
        for name in names
    }
    for name, (test, reference) in pairs.items():
        for dynamic_range in ("LDR", "HDR"):
            print(f'("{name}", "{dynamic_range}", {flip(test, reference, dynamic_range):.7f}),')
    for name, (test, reference) in pairs.items():
        for display in DISPLAYS:
            print(f'("{name}", "{display}", {jod(test, reference, display):.6f}),')
    # Six frames that blink: every other one is the test picture.
    for name, (test, reference) in pairs.items():
        blinking = numpy.stack([test if k % 2 else reference for k in range(6)])
        still = numpy.stack([reference] * 6)
        print(f'("{name}", {jod(blinking, still, "standard_4k", 20.0):.6f}),')


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
