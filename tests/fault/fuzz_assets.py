"""S5: mutants of files of every format: each loads or is refused by its name and a reason, soon and
within the memory of a decoder; the daemon lives, and the next request is answered as before.

usage: fuzz_assets.py [--short] [--count N] [--formats a,b] [--seeds FOLDER] [--keep FOLDER]

Most go to decode-each (tests/fuzz), which gives each a process with a decoder's limits; one in
twenty goes through DecodeAsset to a daemon's sandbox. Mutant k of a format is the same in every
run. --seeds: files of a folder are seeds too, and lie by their endings; --keep: the files of what
ended its process are written there. A decoder that crashes is not the daemon's end; it is a fault
of the parser all the same, and counts as missed.
"""

import argparse
import collections
import concurrent.futures
import hashlib
import os
import pathlib
import struct
import subprocess
import time

import common
import file_mutants
import heliograph as hg
import numpy as np
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire.launch import find_program

SECONDS = 5.0
MEMORY_MIB, CPU_SECONDS = 2048, 20  # of a decoder
SHARE = 20  # one in so many goes through the daemon
REFUSALS = (hg.InvalidArgument, hg.NotFound, hg.Unimplemented, hg.ResourceExhausted)
GLB = file_mutants.ASSETS / "gltf/simple-instancing.glb"
COLUMNS = ("format", "mutants", "decoded", "refused", "crashes", "slowest ms", "most MiB")


class Tally:
    """Outcomes of the mutants of a format."""

    def __init__(self, kind):
        self.kind = kind
        self.counts = collections.Counter()
        self.slowest_ms, self.most_mib = 0.0, 0
        self.crashes, self.faults = [], []  # (trial, how it ended), words

    def check(self, files, where_and_why):
        """A refusal names the file and the reason."""
        where, _, why = where_and_why.partition(": ")
        if not why or not any(name in where_and_why for name in files):
            self.faults.append(f"refused without its name or a reason: {where_and_why!r}")

    def row(self):
        found = [self.counts[key] for key in ("decoded", "refused", "ended")]
        return [self.kind, sum(found), *found, round(self.slowest_ms), self.most_mib or ""]


# ---------------------------------------------------------------- without the daemon


class Decodes:
    """decode-each: an answer for each bundle."""

    def __init__(self):
        program = pathlib.Path(find_program()).with_name("decode-each")
        command = [str(program), str(MEMORY_MIB << 20), str(CPU_SECONDS)]
        pipe, nothing = subprocess.PIPE, subprocess.DEVNULL  # a decoder is silent too
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=nothing)

    def __call__(self, files):
        """code, signal, CPU ms, wall ms, peak MiB, "where: message"."""
        parts = [struct.pack("<I", len(files))]
        for name, data in files.items():
            for part in (name.encode(), data):
                parts += [struct.pack("<I", len(part)), part]
        self.process.stdin.write(b"".join(parts))
        self.process.stdin.flush()
        code, signal, cpu, wall, mib, text = self.process.stdout.readline().decode().split("\t", 5)
        return int(code), int(signal), float(cpu), float(wall), int(mib), text.rstrip("\n")

    def end(self):
        self.process.stdin.close()
        self.process.wait()


def fuzz(kind, seeds, count, keep):
    """Mutants of one format, without the daemon."""
    tally, decode = Tally(kind), Decodes()
    for trial in range(count):
        files = file_mutants.mutant(seeds, trial, kind)
        code, signal, cpu, wall, mib, text = decode(files)
        tally.slowest_ms, tally.most_mib = max(tally.slowest_ms, cpu), max(tally.most_mib, mib)
        tally.counts["decoded" if code == 0 else "ended" if code < 0 else "refused"] += 1
        if code > 0:
            tally.check(files, text)
        elif code < 0:
            tally.crashes.append((trial, signal, round(wall)))
            store(files, keep, f"{kind}-{trial}")
    decode.end()
    return tally


def store(files, keep, name):
    """A mutant as a folder, for whoever mends its parser."""
    if keep is not None:
        for path, data in files.items():
            place = keep / name / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(data)


# ---------------------------------------------------------------- through the daemon


class Files:
    """Decodes files of one client."""

    def __init__(self, client):
        self.connection = client.connection

    def upload(self, data):
        if not data:
            return b""  # one that nobody has
        digest = hashlib.sha256(data).digest()
        request = service.UploadBlobRequest(sha256=digest, size=len(data), chunk=data)
        self.connection.push("UploadBlob", iter([request]))
        return digest

    def decode(self, files):
        bundle = [service.BundleFile(path=n, sha256=self.upload(data)) for n, data in files.items()]
        request = service.DecodeAssetRequest(files=bundle)
        for reply in self.connection.stream("DecodeAsset", request, timeout=4 * SECONDS):
            last = reply
        return last


def fuzz_daemon(client, kind, seeds, trials):
    """Mutants of one format, through a session of their own: blobs live as long as it."""
    tally = Tally(kind)
    with hg.connect(client.address) as own:
        files = Files(own)
        for trial in trials:
            bundle = file_mutants.mutant(seeds, trial, kind)
            if not next(iter(bundle.values())):
                continue  # there is no empty blob
            start = time.perf_counter()
            try:
                files.decode(bundle)
                tally.counts["decoded"] += 1
            except REFUSALS as error:
                tally.counts["ended" if "its decoder" in str(error) else "refused"] += 1
                tally.check(bundle, str(error))
            tally.slowest_ms = max(tally.slowest_ms, 1e3 * (time.perf_counter() - start))
    return tally


def beside_a_scene(client, seeds, count, report):
    """The daemon's share, with a picture before and after it. The tallies."""
    with hg.connect(client.address) as own:
        scene = common.stage(own, 32, 24)
        before = scene.render("cam", planes=["beauty"], spp=2)["beauty"]
        size = common.resident(common.pid_of(client))
        step = 1 if common.SHORT else SHARE
        trials = range(0, count, step) if not common.SHORT else range(4)
        tallies = table(
            "through the daemon",
            (fuzz_daemon(client, kind, listed, trials) for kind, listed in seeds.items()),
        )
        after = scene.render("cam", planes=["beauty"], spp=2)["beauty"]
        report.figure("the next request differs", not np.array_equal(before, after), 0)
        with scene.edit() as edit:
            edit.import_file(GLB)
    report.figure("crashes", client.connection.daemon.exit_code() is not None, 0, slack=False)
    grown = (common.resident(common.pid_of(client)) - size) / 1e6
    report.figure("growth of the daemon's memory", grown, 100, "MB", slack=False)
    return tallies


# ---------------------------------------------------------------- report


def table(title, tallies):
    """Prints a row as soon as it is there; the tallies."""
    print(f"\n{title}")
    print(line(COLUMNS))
    return [tally for tally in tallies if print(line(tally.row()), flush=True) is None]


def line(cells):
    return f"  {cells[0]:8}" + "".join(f"{cell:>12}" for cell in cells[1:])


def judge(tallies, report):
    """Figures of each format."""
    for tally in tallies:
        name = tally.kind
        slow = tally.slowest_ms / 1e3
        if slow > SECONDS:
            report.figure(f"{name}: slowest", slow, SECONDS, "s")
        for trial, signal, wall in tally.crashes:
            print(f"  {name}-{trial}: ended by {signal} after {wall} ms")
        if tally.counts["ended"]:
            report.figure(f"{name}: decoders that crashed", tally.counts["ended"], 0)
        if tally.faults:
            report.figure(f"{name}: {tally.faults[0]}", len(tally.faults), 0)
    most = max(tally.most_mib for tally in tallies)  # the daemon reports none
    report.figure("most memory of a decoder", most, MEMORY_MIB, "MiB", slack=False)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--count", type=int, default=common.size(10_000, 40))
    parser.add_argument("--formats", type=lambda text: text.split(","))
    parser.add_argument("--seeds", type=pathlib.Path)
    parser.add_argument("--keep", type=pathlib.Path)
    return parser.parse_args()


def main():
    given = arguments()
    seeds = file_mutants.seeds(given.seeds)
    seeds = {kind: seeds[kind] for kind in given.formats or seeds}
    # Less than by default: a volume may be just below it, and copies of 1 GiB take seconds.
    flags = ("--grace", "0", "--limit", f"decode_result_bytes={256 << 20}")
    with common.Report("S5 malformed assets") as report, common.daemon(*flags) as client:
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            tallies = pool.map(lambda k: fuzz(k, seeds[k], given.count, given.keep), seeds)
            judge(table("in processes of their own", tallies), report)
        judge(beside_a_scene(client, seeds, given.count, report), report)


if __name__ == "__main__":
    main()
