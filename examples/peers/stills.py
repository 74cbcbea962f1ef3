"""Stills at equal error: Lightloom, Cycles with OpenImageDenoise, and Mitsuba, against the references of ../shared/peers.

    P=.../mitsuba-venv/bin/python; export BPY_PYTHON=.../bpy-venv/bin/python
    $P examples/peers/stills.py out/peers [indirect_room] [staircase] [manylights]

For each scene `lightloom init` writes a graph, which runs from an empty cache with more and more columns. The
peers run beside it, so that times are of one machine at one time. `cpu/2 s` is the one to read on a busy machine.
Our times are those of whole processes from the glTF file to the EXR; those of the peers leave out import and hierarchies.

The references end paths after ten segments, which takes a tenth of the room's light. Photons go on, so what is missing
is path traced and added to the reference, and the peers trace without end, too.
"""

import json
import subprocess
import sys
from pathlib import Path

import ours

SHARED = ours.PEERS.parent
# File, size, whether every material is made Lambertian, samples for what the reference lacks, and options of the peers.
SCENES = {
    "indirect_room": (ours.PEERS / "references/indirect_room.glb", (320, 240), False, 1024, []),
    "staircase": (SHARED / "scenes/staircase/staircase.glb", (240, 320), True, 16, ["--lambert"]),
    "manylights": (ours.PEERS / "references/manylights.glb", (320, 240), False, 0, ["--power-weights"]),
}
# Bins for rows, columns, and photons; those in the fourth line are as `init` has them.
SETTINGS = [
    ("(12, 9)", 100, 10_000),
    ("(12, 9)", 300, 30_000),
    ("(20, 15)", 500, 100_000),
    ("(20, 15)", 1000, 100_000),
    ("(28, 21)", 1500, 300_000),
]


def reference(name, folder):
    """The harness's reference with the light of longer paths."""
    import numpy as np

    import truth
    from exr_io import read_exr, write_exr
    from metrics import luminance

    file, size, lambert, spp, _ = SCENES[name]
    given, out = ours.PEERS / f"references/{name}.exr", folder / f"references/{name}.exr"
    if spp == 0 or out.exists():
        return out if spp else given
    tail = folder / f"references/{name}_tail"
    truth.between(truth.TAIL, file, tail, size, spp, 8, lambert)
    more, variance = read_exr(f"{tail}.exr").astype(float), np.load(f"{tail}.npy")
    image = read_exr(given).astype(float)
    whole = image + more
    relative = variance / (whole**2 + (0.1 * luminance(whole).mean()) ** 2)
    noise = json.loads(given.with_suffix(".json").read_text())
    # The two are independent, and what is added is small: their squares add up.
    noise = {key: noise[key] + float(relative.mean()) for key in ("ref_relmse", "ref_relmse_t")}
    out.with_suffix(".json").write_text(json.dumps(noise))
    write_exr(out, whole)
    print(f"{name}: paths of more than ten segments add {100 * more.sum() / image.sum():.1f} %; the reference's noise is "
          f"{100 * noise['ref_relmse_t'] ** 0.5:.1f} %, {100 * relative.mean() ** 0.5:.1f} % of it theirs", flush=True)
    return out


def mine(name, folder):
    """Renders a scene at all settings; the peers' runs.json."""
    file, size, lambert, _, _ = SCENES[name]
    graph = folder / f"{name}.ron"
    scene = ours.lambertian(file, folder / name / file.name) if lambert else file
    ours.lightloom("init", scene, "--frames", 1, "--size", f"{size[0]}x{size[1]}", "--out", graph, "--force")
    runs = []
    for bins, columns, photons in SETTINGS:
        out = folder / name / f"{columns}_{photons}"
        values = {"rows": bins, "columns": columns, "photons.count": photons}
        document, wall, cpu = ours.run(graph, out, values)
        exr = ours.published(document, "frame")[0].resolve()
        runs.append({"exr": str(exr), "wall_s": wall, "cpu_s": cpu, "label": f"{columns}/{photons // 1000}k"})
    path = folder / f"{name}.runs.json"
    path.write_text(json.dumps({"name": "Lightloom, columns / photons", "unbiased": False, "runs": runs}, indent=1))
    return path


def main():
    folder, names = Path(sys.argv[1]), sys.argv[2:] or list(SCENES)
    if not ours.PEERS.exists():
        raise SystemExit(f"{ours.PEERS} is absent: nothing to compare with (set PEERS to the harness)")
    sys.path.insert(0, str(ours.PEERS))
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        file, size, _, _, options = SCENES[name]
        runs = mine(name, folder)
        common = [sys.executable, ours.PEERS / "equal_error.py", file, "--size", *size, "--max-depth", -1,
                  "--reference", reference(name, folder), "--targets", 0.2, 0.1, 0.05, *options]
        print(f"== {name}", flush=True)
        for what in (["--external", runs], ["--peer", "cycles", "--denoise", "--spp", 1, 4, 16],
                     ["--peer", "mitsuba", "--spp", 16, 64]):
            done = subprocess.run(list(map(str, [*common, *what])), capture_output=True, text=True)
            print(done.stdout or f"not run: {done.stderr.strip().splitlines()[-1]}", flush=True)


if __name__ == "__main__":
    main()
