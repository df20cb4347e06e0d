"""Writes the corpus of the libFuzzer target: what the Python client asks in the tour of
tests/fault/mutants.py, as it goes over the wire.

usage: .venv/bin/python tests/fuzz/make_corpus.py"""

import hashlib
import pathlib
import sys
import tempfile

import heliograph as hg
from heliograph._wire._proto import render_pb2, scene_pb2, service_pb2

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "fault"))
import mutants  # noqa: E402

LARGEST = 3000  # bytes; an edit that is larger is left out
MODEL = HERE.parent / "assets/gltf/simple-instancing.glb"


def inputs(seeds):
    """Kind and message of each input; a transaction edit by edit."""
    for data in seeds["heliograph.v1.ApplyRequest"]:
        for edit in service_pb2.ApplyRequest.FromString(data).transaction.edits:
            yield "t", scene_pb2.Transaction(edits=[edit])
    for data in seeds["heliograph.v1.RenderRequest"]:
        yield "r", render_pb2.RenderRequest.FromString(data)
    for data in seeds["heliograph.v1.QueryRequest"]:
        yield "q", service_pb2.QueryRequest.FromString(data)
    for data in seeds["heliograph.v1.TracksRequest"]:
        yield "k", service_pb2.TracksRequest.FromString(data)


def main():
    seeds = mutants.record()
    with tempfile.TemporaryDirectory() as folder, hg.connect() as client:
        mutants.tour(client, MODEL, pathlib.Path(folder))
    (HERE / "corpus").mkdir(exist_ok=True)
    for kind, message in inputs(seeds):
        data = kind.encode() + message.SerializeToString(deterministic=True)
        if len(data) <= LARGEST:
            name = f"{kind}-{hashlib.sha256(data).hexdigest()[:12]}"
            (HERE / "corpus" / name).write_bytes(data)


if __name__ == "__main__":
    main()
