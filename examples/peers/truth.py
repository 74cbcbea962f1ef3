"""Light of some bounces alone, path traced: paths of at most so many segments minus shorter paths.

Both renders of a batch have the same seed, so they follow the same paths and what they have in common cancels. Writes
OUT.exr, OUT.npy with the variance of each of its numbers, and OUT.json with what it cost.
"""

import json
import math
from pathlib import Path

import numpy as np

from exr_io import write_exr
from peers import RenderSpec, SceneSpec, make_peer

# Segments of paths, as the harness counts: with one bounce of indirect light and with direct light; without end and those
# of its references.
ONE_BOUNCE = (3, 2)
TAIL = (-1, 10)


def between(depths, glb, out, size, spp, batches, lambert=False):
    """Renders `spp` samples a pixel in `batches` independent parts; returns what OUT.json holds."""
    peers = [make_peer("mitsuba", SceneSpec(str(glb), *size, max_depth=depth, lambert=lambert)) for depth in depths]
    parts, cpu = [], 0.0
    for batch in range(batches):
        longer, shorter = (peer.render(RenderSpec(max(1, spp // batches), 1000 + batch)) for peer in peers)
        parts.append(longer.image.astype(np.float64) - shorter.image)
        cpu += longer.cpu_s + shorter.cpu_s
    parts = np.stack(parts)
    mean = parts.mean(0)
    variance = parts.var(0, ddof=1) / batches
    info = {
        "spp": spp,
        "batches": batches,
        "cpu_s": cpu,
        # |noise| / |truth|, the 2-norm over all pixels and channels.
        "relative_l2": math.sqrt(variance.sum() / (mean**2).sum()),
        # Of the sum of all pixels: what the energy of a comparison cannot know better.
        "energy": float(np.std(parts.sum((1, 2, 3)), ddof=1) / math.sqrt(batches) / mean.sum()),
    }
    Path(out).parent.mkdir(parents=True, exist_ok=True)
    write_exr(f"{out}.exr", mean)
    np.save(f"{out}.npy", variance)
    Path(f"{out}.json").write_text(json.dumps(info, indent=1))
    return info


def smooth(glb, size, fine=4, floor=False):
    """Pixels that see one surface alone, and whose neighbours do: what no pixel filter decides. (h, w), True or False. With
    `floor` only those that see what lies lowest."""
    width, height = size
    peer = make_peer("mitsuba", SceneSpec(str(glb), width * fine, height * fine), sampler="independent")
    aov = peer.mi.load_dict({"type": "aov", "aovs": "p:position,n:geo_normal,s:shape_index,d:depth"})
    seen = np.array(peer.mi.render(peer._scene, integrator=aov, spp=1), np.float64)
    cells = seen.reshape(height, fine, width, fine, -1)
    up = cells[..., 1].max((1, 3))
    low = up < up.min() + 1e-3 * np.ptp(up) if floor else True
    cells = cells[..., 3:]
    cells[..., -1] = np.log(np.maximum(cells[..., -1], 1e-6))
    alike = (cells.max((1, 3)) - cells.min((1, 3)) < 0.2).all(-1)
    around = np.pad(alike, 1, mode="edge")
    return np.logical_and.reduce([around[y : y + height, x : x + width] for y in range(3) for x in range(3)]) & low
