"""Runs Lightloom from Python: a graph with overrides, with an empty cache, on the clock."""

import json
import os
import resource
import shutil
import struct
import subprocess
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
# ../shared/peers, the harness; not part of the project.
PEERS = Path(os.environ.get("PEERS", ROOT.parent / "shared" / "peers"))


def binary():
    """The release build: $LIGHTLOOM, or where cargo puts it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    path = Path(os.environ.get("LIGHTLOOM", target / "release" / "lightloom"))
    if not path.exists():
        raise SystemExit(f"{path} does not exist: run `cargo build --release`, or name the program in LIGHTLOOM")
    return path


def lightloom(*arguments):
    """One command; its JSON, wall seconds and processor seconds of all threads."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([binary(), "--json", *map(str, arguments)], capture_output=True, text=True)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - start
    if done.returncode:
        raise SystemExit(f"lightloom {' '.join(map(str, arguments))}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout), wall, cpu


def run(graph, out, values, cache=None):
    """Runs `graph` with `values`; its document and times. Without a `cache`, from nothing."""
    own = Path(out) / "cache"
    if cache is None:
        shutil.rmtree(own, ignore_errors=True)
    sets = [word for name, value in values.items() for word in ("--set", f"{name}={value}")]
    result = lightloom("--cache", cache or own, "run", graph, "--out", out, *sets)
    if cache is None:
        shutil.rmtree(own, ignore_errors=True)
    return result


def published(document, output):
    """The files of one output, in order."""
    return [Path(p["path"]) for p in document["published"] if p["output"] == output]


def quoted(path):
    """A path as a value of a graph file."""
    return json.dumps(str(Path(path).resolve()))


def edited(glb, out, change):
    """A copy of a GLB whose JSON `change` has changed in place."""
    data = Path(glb).read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    change(document)
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    out = Path(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    size = 20 + len(text) + len(rest)
    out.write_bytes(struct.pack("<4sIIII", b"glTF", 2, size, len(text), 0x4E4F534A) + text + rest)
    for beside in Path(glb).parent.iterdir():
        # Textures that the file names, next to the copy.
        if beside.suffix.lower() in (".png", ".jpg", ".jpeg", ".bin") and not (out.parent / beside.name).exists():
            shutil.copy(beside, out.parent / beside.name)
    return out


def lambertian(glb, out):
    """A copy of a GLB whose materials reflect their base colour and nothing else: what the peers' `--lambert` renders."""

    def change(document):
        for material in document.get("materials", []):
            material.setdefault("pbrMetallicRoughness", {})["metallicFactor"] = 0.0
            material.setdefault("extensions", {})["KHR_materials_specular"] = {"specularFactor": 0.0}
        used = document.setdefault("extensionsUsed", [])
        if "KHR_materials_specular" not in used:
            used.append("KHR_materials_specular")

    return edited(glb, out, change)


def metal_floor(glb, out, roughness):
    """A copy of a GLB whose lowest mesh is a metal of this roughness and of the colour that it had."""

    def change(document):
        def top(mesh):
            return max(document["accessors"][part["attributes"]["POSITION"]]["max"][1] for part in mesh["primitives"])

        for part in min(document["meshes"], key=top)["primitives"]:
            colour = document["materials"][part["material"]]["pbrMetallicRoughness"].get("baseColorFactor", [1.0] * 4)
            metal = {"baseColorFactor": colour, "metallicFactor": 1.0, "roughnessFactor": roughness}
            part["material"] = len(document["materials"])
            document["materials"].append({"pbrMetallicRoughness": metal})

    return edited(glb, out, change)
