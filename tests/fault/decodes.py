"""Decodes of several tenants: pictures of one do not hold up another's triangle; what a file
beneath the asset root costs is charged before it is read.
"""

import concurrent.futures
import struct
import time
import zlib

import common
import heliograph as hg
import served
from heliograph._wire._proto import service_pb2 as service
from heliograph.scene import assets

SIDE = common.size(5000, 3400)  # pixels of a picture, each way: long beside a triangle
PICTURES = common.size(60, 24)
TRIALS = common.size(20, 5)
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n# {}\n"
HOLE = 256 << 20  # bytes of a file without any on the disk


def picture(side, number):
    """Rows that a decoder has to undo one by one; each number another file."""
    row = b"\4" + bytes((3 * i + 7) % 251 for i in range(3 * side))
    packer = zlib.compressobj(1)
    rows = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()

    def chunk(kind, data):
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    header = chunk(b"IHDR", struct.pack(">2I5B", side, side, 8, 2, 0, 0, 0))
    name = chunk(b"tEXt", b"Title\0" + str(number).encode())
    body = chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + header + name + body


def seconds_of(client, path):
    began = time.perf_counter()
    assets.decode_bundle(client, assets.Source(path))
    return time.perf_counter() - began


def triangles(client, place, name):
    """Seconds that each of some triangles takes, one after the other."""
    taken = []
    for i in range(TRIALS):
        path = place / f"{name}_{i}.obj"
        path.write_text(TRIANGLE.format(f"{name} {i}"))
        taken.append(seconds_of(client, path))
    return taken


def check_turns(report, place):
    paths = [place / f"{i}.png" for i in range(PICTURES + 1)]
    for i, path in enumerate(paths):
        path.write_bytes(picture(SIDE, i))
    tenants = served.tenants_file(place)
    with (
        served.served("--tenants", tenants, folder=place) as daemon,
        hg.connect(daemon.socket, token=served.TOKENS["robots"]) as many,
        hg.connect(daemon.socket, token=served.TOKENS["vision"]) as few,
        concurrent.futures.ThreadPoolExecutor(PICTURES) as pool,
    ):
        alone = max(triangles(few, place, "alone"))
        slot = seconds_of(many, paths.pop())
        print(f"    a triangle alone: {1000 * alone:.0f} ms; a picture alone: {slot:.2f} s")
        waiting = [pool.submit(seconds_of, many, path) for path in paths]
        time.sleep(slot)
        beside = max(triangles(few, place, "beside"))
        unfinished = sum(not each.done() for each in waiting)
        report.figure("pictures that waited then: fewer than 2", int(unfinished < 2), 0)
        most = common.size(1.5, 4)  # of those that wait, three are decoded at a time
        report.figure("a triangle beside them, in pictures", beside / slot, most, slack=False)
        failed = sum(each.exception() is not None for each in waiting)
        report.figure(f"of {PICTURES} pictures, failed", failed, 0)


def check_charges(report, place):
    root = place / "root"
    root.mkdir()
    for i in range(16):
        with (root / f"{i}.png").open("wb") as file:
            file.truncate(HOLE)

    def refused(client, i):
        request = service.DecodeAssetRequest(server_path=f"{i}.png")
        try:
            list(client.connection.stream("DecodeAsset", request, timeout=60))
        except hg.ResourceExhausted as error:
            return error.needed == HOLE
        return False

    with (
        common.daemon("--asset-root", str(root), tenant_bytes=HOLE // 4) as client,
        concurrent.futures.ThreadPoolExecutor(16) as pool,
    ):
        before = common.resident(common.pid_of(client))
        wrong = sum(not each for each in pool.map(lambda i: refused(client, i), range(16)))
        report.figure("of 16 files over the quota, read", wrong, 0)
        grown = (common.peak(common.pid_of(client)) - before) >> 20
        report.figure("the daemon grew by, MiB", grown, 64, slack=False)
        report.figure("bytes charged after it", common.used(client, "tenant_bytes"), 0)


def main():
    with common.Report("decodes") as report, served.folder() as place:
        check_charges(report, place)
        check_turns(report, place)


if __name__ == "__main__":
    main()
