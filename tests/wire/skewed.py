"""A client of any version of the contract, and what it does with a daemon: the calls that scenes
are made and shown with, on a scene that has one of each of its things. Used by test_skew.py."""

import base64
import hashlib
import json
import socket

import grpc
import numpy as np
from contracts import ROOT, Contract
from google.protobuf import json_format

DTYPES = {1: "<u1", 2: "<u2", 3: "<u4", 4: "<i4", 5: "<u8", 6: "<f2", 7: "<f4", 8: "<f8"}
MODEL = ROOT / "tests/assets/gltf/01_morphed_cube/01_morphed_cube.gltf"
PLANES = ["BEAUTY", "DEPTH", "NORMAL", "INSTANCE", "BASE_COLOR", "FLOW_BACKWARD", "MATERIAL"]


def array(values, dtype: str) -> dict:
    data = np.array(values, dtype)
    number = next(k for k, v in DTYPES.items() if v == data.dtype.str or v[1:] == dtype)
    return {
        "dtype": number,
        "shape": list(data.shape),
        "inline": base64.b64encode(data.tobytes()).decode(),
    }


def named(name: str) -> dict:
    return {"name": name}


def pose(x: float, y: float, z: float) -> dict:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return {"matrices": array(matrix, "f4")}


def edits() -> list[dict]:
    """Two triangles 2 m before a camera, lit by what they emit and by the dome."""
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    mesh = {
        "positions": array(corners, "f4"),
        "indices": array([[0, 1, 2], [0, 2, 3]], "u4"),
        "uvs": array([[0, 0], [1, 0], [1, 1], [0, 1]], "f4"),
        "parts": array([0, 1], "u4"),
        "keypoints": [{"name": "tip", "position": {"z": 0.5}}],
    }
    texels = {"texels": array(np.full((2, 2, 3), 0.5), "f4"), "filter": "FILTER_NEAREST"}
    glow = {"emission": {"value": {"x": 1, "y": 2, "z": 3}}, "base_color": {"value": {}}}
    paint = {"base_color": {"texture": {"texture": named("dots")}}, "alpha_mode": "ALPHA_MODE_MASK"}
    camera = {"width": 32, "height": 24, "fx": 20, "fy": 20, "cx": 15.5, "cy": 11.5}
    wall = {
        "parent": named("room"),
        "pose": pose(0, 0, -2),
        "mesh": named("quad"),
        "materials": {"parts": [named("glow"), named("paint")]},
        "label": {"value": 7, "category": "wall"},
        "attributes": {"values": {"made": "here"}},
    }
    white = {"color": {"x": 1, "y": 1, "z": 1}}
    far = np.eye(4)
    far[2, 3] = 1000
    instances = {"prototype": {"mesh": named("quad")}, "matrices": array([far, far], "f4")}
    return [
        {"settings": {"time": 0, "categories": ["wall"], "dome": white}},
        {"target": named("dots"), "texture": texels},
        {"target": named("glow"), "material": glow},
        {"target": named("paint"), "material": paint},
        {"target": named("quad"), "mesh": mesh},
        {"target": named("room"), "entity": {"pose": pose(0, 0, 0)}},
        {"target": named("wall"), "mode": "MODE_CREATE", "entity": wall},
        {"target": named("behind"), "instances": instances},
        {"target": named("cam"), "entity": {"camera": camera}},
    ]


class Client:
    """One session of a client of `contract`; requests are dicts in the JSON of Protocol Buffers."""

    def __init__(self, contract: Contract, daemon):
        self.contract = contract
        self.channel = grpc.insecure_channel(
            daemon.target, options=[("grpc.use_local_subchannel_pool", 1)]
        )
        self.local_channel = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.local_channel.connect(daemon.socket + ".fd.sock")
        self.metadata = []
        self.opened = self.call(
            "OpenSession", ticket=_text(self.local_channel.recv(64)), client="skew"
        )
        self.metadata = [("heliograph-session", str(self.opened.session))]
        self.last = {}

    def make(self, method: str, **fields):
        return json_format.ParseDict(fields, self.contract.request(method))

    def send(self, method: str, request):
        """A request, or a list of them; the reply, or a list of them."""
        found, call = self.contract.methods[method], self.contract.callable(self.channel, method)
        given = iter(request if isinstance(request, list) else [request])
        reply = call(
            given if found.client_streaming else next(given), metadata=self.metadata, timeout=30
        )
        return list(reply) if found.server_streaming else reply

    def call(self, method: str, **fields):
        return self.send(method, self.make(method, **fields))

    def apply(self, scene: int, listed: list[dict]):
        self.last[scene] = self.last.get(scene, 0) + 1
        transaction = {"edits": listed}
        return self.call("Apply", scene=scene, number=self.last[scene], transaction=transaction)

    def upload(self, data: bytes) -> bytes:
        """Its hash."""
        digest = hashlib.sha256(data).digest()
        self.call("UploadBlob", sha256=_text(digest), size=len(data), chunk=_text(data))
        return digest

    def render(self, scene: int, planes=PLANES, **fields):
        """(header, planes by name) of one frame."""
        wanted = [{"plane": f"PLANE_{name}"} for name in planes]
        fields = {"cameras": [named("cam")], "planes": wanted, "spp": 4, "seed": 7, **fields}
        fields |= {"hold": True, "frame_interval": 0.5}
        return frame(self.call("Render", scene=scene, **fields))

    def close(self) -> None:
        self.call("CloseSession")
        self.channel.close()
        self.local_channel.close()


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def frame(parts):
    header, buffers = None, []
    for part in parts:
        if part.HasField("header"):
            header = part.header
            buffers = [bytearray(plane.size) for plane in header.planes]
        elif part.HasField("chunk"):
            chunk = part.chunk
            buffers[chunk.plane][chunk.offset : chunk.offset + len(chunk.chunk)] = chunk.chunk
    planes = {
        info.name: np.frombuffer(data, DTYPES[info.dtype]).reshape(header.height, header.width, -1)
        for info, data in zip(header.planes, buffers, strict=True)
    }
    return header, planes


def columns(reply) -> dict[str, np.ndarray]:
    return {
        column.name: np.frombuffer(column.data, DTYPES[column.dtype]).reshape(column.shape)
        for column in reply.columns
    }


def decode(client: Client):
    """The asset of a model and its companion."""
    files = []
    for path in (MODEL, MODEL.with_suffix(".bin")):
        files.append({"path": path.name, "sha256": _text(client.upload(path.read_bytes()))})
    return client.call("DecodeAsset", files=files)[-1].asset


def tour(client: Client) -> dict:
    """The calls; what came of each."""
    found = {}
    scene = client.call("CreateScene", request_id="tour", name="tour").scene
    found["revision"] = client.apply(scene, edits()).revision
    found["header"], found["first"] = client.render(scene)
    request = json.loads(found["header"].manifest)["request"]
    found["again"] = frame(client.call("Render", **{**request, "scene": scene}))[1]
    client.apply(
        scene,
        [
            {"advance": {"dt": 0.5}},
            {"target": named("wall"), "mode": "MODE_UPDATE", "entity": {"pose": pose(0, 0, -3)}},
        ],
    )
    _, found["moved"] = client.render(scene)
    read = client.call("Read", scene=scene, refs=[named("wall")], fields=["pose", "entity"])
    found["pose"] = np.frombuffer(read[0].array.inline, "<f4").reshape(4, 4)
    found["label"] = read[1].object.entity.label.value
    rays = {"origins": array([[0, 0, 0]], "f4"), "directions": array([[0, 0, -1]], "f4")}
    (answer,) = client.call("Query", scene=scene, cast_rays=rays)
    found["ray"] = columns(answer)
    branch = client.call("BranchScene", request_id="branch", scene=scene).scene
    move = {"edits": [{"target": named("wall"), "entity": {"pose": pose(0, 0, -5)}}]}
    stream = [client.make("ApplyStream", scene=branch, number=1, transaction=move)]
    client.last[branch] = 1
    found["streamed"] = [reply.revision for reply in client.send("ApplyStream", stream)]
    _, found["branch"] = client.render(branch)
    chunks = client.call("ExportScene", scene=branch)
    chunks[0].header.request_id, chunks[0].header.name = "loaded", "loaded"
    _, found["loaded"] = client.render(client.send("ImportScene", chunks).scene)
    asset = decode(client)
    place = {"asset": _text(asset.sha256), "pose": pose(0, 0, -3.5)}
    client.apply(branch, [{"target": named("model"), "instantiate": place}])
    found["materials"] = list(asset.materials)
    _, found["model"] = client.render(branch, ["INSTANCE"])
    found["scenes"] = sorted(info.name for info in client.call("ListScenes").scenes)
    tree = client.call("DescribeScene", scene=scene, tree=True, memory=True)
    found["objects"] = sorted(o.name for o in tree.objects)
    found["opened"] = client.call("OpenScene", name="tour").scene == scene
    for each in (scene, branch):
        client.call("DeleteScene", request_id=f"gone {each}", scene=each)
    found["info"] = client.call("GetServerInfo")
    return found
