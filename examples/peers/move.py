"""Eight frames of a moving camera: error and flicker of Lightloom, Cycles with OpenImageDenoise, and Mitsuba.

    P=.../mitsuba-venv/bin/python; export BPY_PYTHON=.../bpy-venv/bin/python
    $P examples/peers/move.py out/peers [cornell_blobs] [--size 160 120] [--spp 1024]

Each peer runs with two numbers of samples, then with those that take as long as each of ours, by the line through the two.
`cpu s/frame` of ours is that of the whole process over the number of frames; the peers' leave out import.
`flicker_t` is without the worst hundredth of the pixels, `8 bit` in steps of the display; metrics.py defines both. The
references' own noise is in all of them alike, and is printed as their floor.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import ours

FRAMES, FPS = 8, 24
# Columns and photons.
SETTINGS = [(200, 30_000), (800, 100_000)]
# Options and two numbers of samples.
PEERS = [(["--peer", "cycles", "--denoise"], 4, 16), (["--peer", "mitsuba"], 16, 64)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scene", nargs="?", default="cornell_blobs")
    parser.add_argument("--size", nargs=2, type=int, default=(160, 120))
    parser.add_argument("--spp", type=int, default=1024)
    options = parser.parse_args()
    if not ours.PEERS.exists():
        raise SystemExit(f"{ours.PEERS} is absent: nothing to compare with (set PEERS to the harness)")
    folder = options.folder / f"move_{options.scene}"
    glb = options.folder / f"scenes/{options.scene}.glb"
    if not glb.exists():
        subprocess.run([sys.executable, ours.PEERS / "make_scenes.py", glb.parent], check=True)
    common = [sys.executable, ours.PEERS / "animation.py", glb, "--size", *options.size, "--frames", FRAMES, "--fps", FPS, "--max-depth", -1]
    references, lines = folder / "references", folder / "table.jsonl"
    if not (references / "references.json").exists():
        subprocess.run(list(map(str, [*common, "--save-references", references, "--spp", options.spp])), check=True)
    floor = json.loads((references / "references.json").read_text())["floor"]
    print(f"floor of the references: flicker_t {floor['flicker_t']:.4f}, {floor['flicker_8bit']:.2f} steps")
    print(f"{'':28} {'cpu s/frame':>11} {'relRMSE':>8} {'flicker_t':>9} {'8 bit':>6} {'FLIP':>6}")

    def row(name, what, cpu=None):
        lines.unlink(missing_ok=True)
        done = subprocess.run(list(map(str, [*common, "--references", references, *what, "--out", lines])), capture_output=True, text=True)
        if done.returncode:
            print(f"{name:28} not run: {done.stderr.strip().splitlines()[-1]}", flush=True)
            return None
        line = json.loads(lines.read_text())
        cpu = line["cpu_s_per_frame"] if cpu is None else cpu
        print(f"{name:28} {cpu:11.2f} {100 * line['relrmse']:7.2f}% {line['flicker_t']:9.4f} {line['flicker_8bit']:6.2f} {line['flip']:6.4f}", flush=True)
        return cpu

    graph = folder / f"{options.scene}.ron"
    ours.lightloom("init", glb, "--frames", FRAMES, "--size", f"{options.size[0]}x{options.size[1]}", "--out", graph, "--force")
    times = []
    for columns, photons in SETTINGS:
        out = folder / f"{columns}_{photons}"
        document, _, cpu = ours.run(graph, out, {"columns": columns, "clusters.limit": max(400, columns), "fps": float(FPS), "photons.count": photons})
        frames = ours.published(document, "frame")
        times.append(row(f"Lightloom, {columns} / {photons // 1000}k", ["--external", frames[0].parent / "*.exr"], cpu / FRAMES))
    for what, few, many in PEERS:
        sampled = lambda spp: row(f"{' '.join(what).replace('--peer ', '')} --spp {spp}", [*what, "--spp", spp])
        cheap, dear = sampled(few), sampled(many)
        for time in times:
            if None not in (cheap, dear, time):
                sampled(max(1, round(few + (time - cheap) * (many - few) / (dear - cheap))))


if __name__ == "__main__":
    main()
