"""Models beside other programs that read them: which of them load each file, how many triangles it
has, their area and box, its textures' mean colours, its joints, cameras and lights.

usage: models.py [--trimesh PYTHON] [--blender PYTHON] [--assimp PYTHON] [--validator COMMAND]
       [--explained FILE] FILE_OR_FOLDER...
Run with .venv/bin/python. PYTHON is one with trimesh (and pillow, networkx, scipy,
charset_normalizer, pycollada), with bpy, or with assimp_py. COMMAND prints the Khronos validator's
report of a glTF, as "gltf_validator -o" does; "-" takes only reports that lie beside the files.
HELIOGRAPHD names the daemon.

A line for each difference, "file: reader: what: ours / theirs", then the counts. --explained: lines
of "reader file-pattern what: reason", where reader and what may be *, take differences out of those
that count; what is the code of the validator's error. Ends with 1 when any is left. Every reader is
a process of its own, and is started anew when it ends or takes longer than --seconds.
"""

import argparse
import collections
import fnmatch
import json
import pathlib
import queue
import subprocess
import sys
import threading

import numpy as np

READERS = pathlib.Path(__file__).parent / "readers"
ENDINGS = ".gltf .glb .obj .ply .stl .dae .fbx .3ds .3mf .x .off .amf".split()
RELATIVE = 1e-4  # of areas, and of places to the size of the box
COLOUR = 0.01  # of a mean of 0 to 1
COUNTS = ("triangles", "joints", "animations", "cameras", "lights")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("places", nargs="+", type=pathlib.Path)
    parser.add_argument("--trimesh", help="a Python with trimesh")
    parser.add_argument("--blender", help="a Python with bpy")
    parser.add_argument("--assimp", help="a Python with assimp_py")
    parser.add_argument("--validator", help="a command, or -")
    parser.add_argument("--explained", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    return parser.parse_args()


def main():
    given = arguments()
    ours = Reader("heliograph", sys.executable, given.seconds)
    pythons = {name: getattr(given, name) for name in ("trimesh", "blender", "assimp")}
    others = [Reader(name, python, given.seconds) for name, python in pythons.items() if python]
    if given.validator:
        command = [] if given.validator == "-" else given.validator.split()
        others.append(Reader("validator", sys.executable, given.seconds, command))
    explained = explanations(given.explained)
    counts, reasons = collections.Counter(), collections.Counter()
    for path in files(given.places):
        found = ours.read(path)
        counts["files"] += 1
        counts["refused by us"] += "refusal" in found
        for other in others:
            theirs = other.read(path)
            differences = list(compared(found, theirs))
            counts[f"as {other.name}"] += not differences
            for what, pair in differences:
                reason = why(explained, other.name, path, what)
                counts["explained" if reason else "unexplained"] += 1
                reasons[reason] += 1
                note = f"  ({reason})" if reason else ""
                print(f"{path}: {other.name}: {what}: {pair}{note}", flush=True)
    for reason, count in reasons.most_common():
        print(f"{count:5} {reason or 'not explained'}")
    print(json.dumps(counts))
    return 1 if counts["unexplained"] else 0


def files(places):
    for place in places:
        listed = sorted(place.rglob("*")) if place.is_dir() else [place]
        for path in listed:
            if path.suffix.lower() in ENDINGS and path.is_file():
                yield path.resolve()


# ---------------------------------------------------------------- readers


class Reader:
    """A program of readers/, which runs in a Python that has its packages."""

    def __init__(self, name, python, seconds, arguments=()):
        self.name, self.seconds = name, seconds
        self.command = [python, str(READERS / f"{name}_reader.py"), *arguments]
        self.process = None

    def read(self, path):
        """Its facts, or a refusal: also that it ended, or took too long."""
        if self.process is None:
            self._start()
        self.process.stdin.write(f"{path}\n")
        self.process.stdin.flush()
        try:
            line = self.lines.get(timeout=self.seconds)
        except queue.Empty:
            line = None
        if line:
            return json.loads(line)
        self.process.kill()
        status, self.process = self.process.wait(), None
        return {"refusal": f"took {self.seconds:g} s" if line is None else f"ended by {status}"}

    def _start(self):
        pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
        self.process = subprocess.Popen(
            self.command, stdin=pipe, stdout=pipe, stderr=nothing, text=True
        )
        self.lines = queue.Queue()
        threading.Thread(target=forward, args=(self.process, self.lines), daemon=True).start()


def forward(process, lines):
    """Passes on the lines of a process, then "": it has ended."""
    for line in process.stdout:
        lines.put(line)
    lines.put("")


# ---------------------------------------------------------------- differences


def compared(ours, theirs):
    """(fact, "ours / theirs") of all that differs. Facts that a reader does not give are not
    compared."""
    if "refusal" in ours or "refusal" in theirs:
        if "refusal" not in ours and "codes" in theirs:
            yield from ((code, "loads / an error") for code in theirs["codes"])
        elif ("refusal" in ours) != ("refusal" in theirs):
            shown = [facts.get("refusal", "loads") for facts in (ours, theirs)]
            yield "loads", " / ".join(shown)
        return
    if "area" not in theirs:
        return
    for what in COUNTS:
        if theirs.get(what) is not None and ours[what] != theirs[what]:
            yield what, f"{ours[what]} / {theirs[what]}"
    if not np.isclose(ours["area"], theirs["area"], rtol=RELATIVE, atol=0):
        yield "area", f"{ours['area']:.7g} / {theirs['area']:.7g}"
    if box_is_off(ours["bounds"], theirs["bounds"]):
        yield "bounds", f"{rounded(ours['bounds'])} / {rounded(theirs['bounds'])}"
    for colour in theirs.get("textures", ()):
        if not any(np.abs(np.subtract(colour, own)).max() < COLOUR for own in ours["textures"]):
            yield "textures", f"{ours['textures'][:8]} / {colour}"


def box_is_off(ours, theirs):
    if ours is None or theirs is None:
        return ours != theirs
    size = np.subtract(theirs[1], theirs[0]).max()
    return not np.allclose(ours, theirs, rtol=0, atol=RELATIVE * size)


def rounded(bounds):
    return None if bounds is None else [[float(f"{v:.5g}") for v in corner] for corner in bounds]


# ---------------------------------------------------------------- explanations


def explanations(path):
    """(reader, pattern of the file, what, reason) of each line that is no comment."""
    out = []
    for line in path.read_text().splitlines() if path else ():
        if line.strip() and not line.startswith("#"):
            head, reason = line.split(": ", 1)
            out.append((*head.split(), reason))
    return out


def why(explained, reader, path, what):
    """The reason of a difference, or ""."""
    for name, pattern, which, reason in explained:
        if name in (reader, "*") and which in (what, "*") and fnmatch.fnmatch(str(path), pattern):
            return reason
    return ""


if __name__ == "__main__":
    sys.exit(main())
