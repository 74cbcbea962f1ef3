"""One bounce of indirect light by points and by virtual lights against a path-traced one, as a table.

    P=.../mitsuba-venv/bin/python
    $P examples/peers/one_bounce.py out/peers [cornell] [indirect_room] [--size 80 60] [--spp 8192] [--floor 0.3]

Makes the scenes with ../shared/peers/make_scenes.py, renders the truth with Mitsuba (minutes; kept), and runs
one_bounce.ron with one value after the other changed. Columns: relative L2 error, energy and PSNR over all pixels, as
our Compare says; then L2 and energy over smooth pixels, those that see one surface as their neighbours do, where no
pixel filter decides, with the truth's own noise taken away. The last line is
the sum over virtual lights, which sees the same surfaces by rays. With --floor the floor is a metal of that
roughness, and smooth pixels are those of the floor.
"""

import argparse
import importlib.util
import math
import subprocess
import sys
from pathlib import Path

import ours

BASE = {"surfels": 100000, "resolution": 8, "factor": 1.0, "full": 0.9, "faces": "front", "bands": 3}
CHANGES = [
    {}, {"surfels": 50000}, {"surfels": 400000}, {"resolution": 16}, {"bands": 5}, {"resolution": 16, "bands": 5},
    {"factor": 2.0}, {"factor": 0.5}, {"full": 1.0}, {"full": 0.75}, {"buffer": "lambert"}, {"faces": "both"},
]


def installed():
    """Leaves with a message where there is nothing to compare with."""
    if not ours.PEERS.exists():
        raise SystemExit(f"{ours.PEERS} is absent: nothing to compare with (set PEERS to the harness)")
    for module in ("mitsuba", "OpenEXR", "numpy"):
        if importlib.util.find_spec(module) is None:
            raise SystemExit(f"this Python has no {module}: install the peers with {ours.PEERS / 'setup.sh'} and run this with their Python")
    sys.path.insert(0, str(ours.PEERS))


def errors(image, truth, where, noise):
    """Relative L2 error without the truth's `noise` (a share of its sum of squares), and energy."""
    squares = ((image - truth)[where] ** 2).sum() / (truth[where] ** 2).sum()
    return math.sqrt(max(squares - noise, 0.0)), image[where].sum() / truth[where].sum()


def table(scene, folder, size, spp, floor):
    """Prints the table of one scene, its floor a metal of roughness `floor` if that is given."""
    import numpy as np

    import truth as path_traced
    from exr_io import read_exr

    glb = folder / f"scenes/{scene}.glb"
    if floor is not None:
        scene = f"{scene}_floor_{100 * floor:.0f}"
        glb = ours.metal_floor(glb, folder / f"scenes/{scene}.glb", floor)
    file = folder / f"truth/{scene}"
    if not file.with_suffix(".exr").exists():
        print(f"{scene}: path tracing {spp} samples a pixel, twice", flush=True)
        path_traced.between(path_traced.ONE_BOUNCE, glb, file, size, spp, 16)
    truth, variance = read_exr(file.with_suffix(".exr")).astype(float), np.load(file.with_suffix(".npy"))
    smooth = path_traced.smooth(glb, size, floor=floor is not None)
    noise = variance[smooth].sum() / (truth[smooth] ** 2).sum()
    print(f"{scene}, {size[0]}x{size[1]}: the truth's own noise is {100 * math.sqrt(variance.sum() / (truth**2).sum()):.2f} % of it, "
          f"{100 * math.sqrt(noise):.2f} % in the {100 * smooth.mean():.0f} % of pixels that are smooth")
    print(f"{'':32}  {'L2':>6} {'energy':>6} {'dB':>5}   smooth: {'L2':>6} {'energy':>6}")
    for change in CHANGES:
        values = {"scene.file": ours.quoted(glb), "truth.file": ours.quoted(file.with_suffix(".exr")),
                  "size": f"({size[0]}, {size[1]})", **BASE, **change}
        document, _, _ = ours.run(ours.HERE / "one_bounce.ron", folder / f"runs/{scene}", values, folder / "cache")
        image = read_exr(ours.published(document, "points")[0]).astype(float)
        figures = dict(next(p["figures"] for p in document["published"] if p["output"] == "error"))
        label = ", ".join(f"{name} {value}" for name, value in change.items()) or "points: " + ", ".join(f"{v}" for v in BASE.values())
        l2, energy = errors(image, truth, smooth, noise)
        print(f"{label:32}  {figures['relative_l2']:6.3f} {figures['energy']:6.3f} {figures['psnr']:5.1f}           {l2:6.4f} {energy:6.4f}", flush=True)
    lights = read_exr(ours.published(document, "lights")[0]).astype(float)
    # The sum starts from what is seen to emit, of which the truth has nothing.
    dark = smooth & (lights.max(-1) < 4 * truth.max(-1) + 0.1 * truth.max())
    l2, energy = errors(lights, truth, dark, noise)
    print(f"{'virtual lights':32}  {'':6} {'':6} {'':5}           {l2:6.4f} {energy:6.4f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="*", default=["cornell", "indirect_room"])
    parser.add_argument("--size", nargs=2, type=int, default=(80, 60))
    parser.add_argument("--spp", type=int, default=8192)
    parser.add_argument("--floor", type=float)
    options = parser.parse_args()
    installed()
    if not (options.folder / "scenes/cornell.glb").exists():
        subprocess.run([sys.executable, ours.PEERS / "make_scenes.py", options.folder / "scenes"], check=True)
    for scene in options.scenes:
        table(scene, options.folder, options.size, options.spp, options.floor)


if __name__ == "__main__":
    main()
