"""S9: every call x {own, another tenant's, guessed, no} id, session and token. What is another
tenant's is answered in the same words as what is not there. A call without a row is a failure.
"""

from __future__ import annotations

import dataclasses
import os
import re
import socket
import struct

import common
import grpc
import served
from authz_rows import (
    CORNERS,
    ROWS,
    decode,
    mesh,
    named,
    sha256,
    small_camera,
    triangle_of,
    upload_of,
)
from google.protobuf import message_factory
from google.rpc import status_pb2
from heliograph._wire._proto import scene_pb2
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire.status import fields_of

METHODS = service.DESCRIPTOR.services_by_name["Renderer"].methods_by_name
WITHOUT_SESSION = ("GetServerInfo", "ListSessions", "OpenSession")


@dataclasses.dataclass
class Answer:
    """Outcome of a call: the code's name, its words without the ids asked for, and facts."""

    code: str
    words: str = ""
    facts: tuple = ()

    @staticmethod
    def of(error):
        data = dict(error.trailing_metadata() or ()).get("grpc-status-details-bin", b"")
        fields = fields_of(status_pb2.Status.FromString(data))
        words = re.sub(r"\b[0-9a-f]{64}\b|\b\d+\b|'[^']*'", "#", error.details() or "")
        return Answer(
            error.code().name, words, (fields.get("field", ""), tuple(fields.get("nearest", ())))
        )


class Caller:
    """A tenant with a session and one of everything in it."""

    def __init__(self, daemon, tenant):
        self.token = served.TOKENS[tenant]
        self.path = daemon.path
        self.channel = served.channel_of(f"unix://{daemon.path}")
        self.local_channels = []
        self.ticket = self.new_ticket()
        self.session = self.open(self.ticket)
        self.name = f"scene of {tenant}"
        self.triangle = triangle_of(tenant)
        self.model = f"# {tenant}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode()
        for data in (self.triangle, self.model):
            self.answer("UploadBlob", [upload_of(data)])
        self.scene = self.ok("CreateScene", service.CreateSceneRequest(name=self.name))[0].scene
        self.asset = self.ok("DecodeAsset", decode(sha256(self.model)))[-1].asset.sha256
        self.apply(
            scene_pb2.Edit(target=named("mesh"), mesh=mesh(inline=struct.pack("<9f", *CORNERS))),
            scene_pb2.Edit(target=named("thing"), entity=scene_pb2.Entity(mesh=named("mesh"))),
            scene_pb2.Edit(target=named("cam"), entity=scene_pb2.Entity(camera=small_camera())),
        )

    def new_ticket(self):
        """Ticket of a local channel that stays open."""
        line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        line.connect(self.path + ".fd.sock")
        self.local_channels.append(line)
        return line.recv(64)

    def open(self, ticket):
        request = service.OpenSessionRequest(client="matrix", ticket=ticket)
        return self.ok("OpenSession", request, session=None)[0].session

    def call(self, name, requests, session="own", token="own"):
        """The replies to one call."""
        found = METHODS[name]
        shape = "_".join(
            "stream" if many else "unary"
            for many in (found.client_streaming, found.server_streaming)
        )
        rpc = getattr(self.channel, shape)(
            f"/heliograph.v1.Renderer/{name}",
            request_serializer=lambda message: message.SerializeToString(),
            response_deserializer=message_factory.GetMessageClass(found.output_type).FromString,
        )
        session = self.session if session == "own" else session
        token = self.token if token == "own" else token
        metadata = [("heliograph-session", str(session))] if session is not None else []
        metadata += [("authorization", f"Bearer {token}")] if token else []
        given = iter(requests) if found.client_streaming else requests[0]
        reply = rpc(given, metadata=metadata, timeout=20)
        return list(reply) if found.server_streaming else [reply]

    def answer(self, name, requests, **how) -> Answer:
        """Outcome of a call; the first status in a reply counts like the call's own."""
        try:
            replies = self.call(name, requests, **how)
        except grpc.RpcError as error:
            return Answer.of(error)
        facts: tuple = ()
        for reply in replies:
            if (status := getattr(reply, "status", None)) and status.code:
                words = re.sub(r"\b[0-9a-f]{64}\b|\b\d+\b|'[^']*'", "#", status.message)
                names = {code.value[0]: code.name for code in grpc.StatusCode}
                return Answer(names[status.code], words, (fields_of(status).get("field", ""),))
            facts += (getattr(reply, "existed", None),)
        return Answer("OK", "", facts)

    def ok(self, name, request, **how):
        return self.call(name, [request], **how)

    def apply(self, *edits):
        self.ok("Apply", self.transaction(self.scene, *edits))

    def transaction(self, scene, *edits):
        """With the number that comes next, in a scene of one's own."""
        number = 1
        if scene == self.scene:
            info = self.ok("DescribeScene", service.DescribeSceneRequest(scene=scene))[0]
            number = info.scene.next_edit
        request = service.ApplyRequest(scene=scene, number=number)
        request.transaction.edits.extend(edits)
        return request

    def new_scene(self):
        return self.ok("CreateScene", service.CreateSceneRequest())[0].scene

    def new_name(self):
        """Name of a scene that is nobody else's."""
        name = f"{self.name} {os.urandom(4).hex()}"
        self.ok("CreateScene", service.CreateSceneRequest(name=name))
        return name

    def new_bytes(self):
        """Bytes of a blob that is nobody else's."""
        data = os.urandom(36)
        self.answer("UploadBlob", [upload_of(data)])
        return data

    def new_upload(self):
        """An anonymous upload; its name."""
        name = os.urandom(8).hex()
        self.answer("UploadBlob", [upload_of(self.triangle, request_id=name, sha256=b"")])
        return name


def ids_of(me, other):
    """By kind: one's own, another tenant's, a guessed and no id."""
    guess = os.urandom(36)
    return {
        "nothing": dict.fromkeys(("own",)),
        "scene": {"own": me.scene, "other": other.scene, "guessed": 1 << 40, "none": 0},
        "name": {"own": me.name, "other": other.new_name(), "guessed": guess[:8].hex(), "none": ""},
        "ticket": {
            "own": me.new_ticket(),
            "other": other.ticket,
            "guessed": guess[:16],
            "none": b"",
        },
        "bytes": {"own": me.triangle, "other": other.new_bytes(), "guessed": guess, "none": b""},
        "blob": {
            "own": sha256(me.triangle),
            "other": sha256(other.triangle),
            "guessed": guess[:32],
            "none": bytes(32),
        },
        "file": {
            "own": sha256(me.model),
            "other": sha256(other.model),
            "guessed": guess[:32],
            "none": bytes(32),
        },
        "asset": {"own": me.asset, "other": other.asset, "guessed": guess[:32], "none": bytes(32)},
        "upload": {
            "own": me.new_upload(),
            "other": other.new_upload(),
            "guessed": "guessed",
            "none": "",
        },
    }


class Matrix:
    """Asks every cell and keeps those that are wrong."""

    def __init__(self):
        self.cells = 0
        self.wrong = []

    def check(self, where, good, *answers):
        self.cells += 1
        if not good:
            self.wrong.append(f"{where}: {'; '.join(map(str, answers))}")

    def ids(self, me, other):
        for name, rows in ROWS.items():
            for row in rows:
                ids = ids_of(me, other)[row.kind]
                if row.kind == "nothing":
                    continue
                answers = {
                    who: me.answer(name, row.make(me, id))
                    for who, id in ids.items()
                    if who != "own" or row.own != "ANY"
                }
                where = f"{name}({row.kind})"
                wanted = {"own": row.own, "other": row.cross, "none": row.none}
                for who, code in wanted.items():
                    if code != "ANY":
                        self.check(f"{where} {who}", answers[who].code == code, answers[who])
                same = answers["other"] == answers["guessed"]
                self.check(f"{where} guessed", same, answers["other"], answers["guessed"])

    def sessions(self, me, other):
        """Another's session, a guessed one and none; another's token for one's own session."""
        for name, rows in ROWS.items():
            if name in WITHOUT_SESSION:
                continue
            request = rows[0].make(me, ids_of(me, other)[rows[0].kind]["own"])
            how = {
                "other": {"session": other.session},
                "guessed": {"session": 1 << 40},
                "none": {"session": None},
                "other's token": {"token": other.token},
            }
            answers = {who: me.answer(name, request, **given) for who, given in how.items()}
            for who, answer in answers.items():
                good = answer.code == "UNAUTHENTICATED"
                good &= who == "none" or answer == answers["guessed"]
                self.check(f"{name} session {who}", good, answer, answers["guessed"])

    def tokens(self, me, other):
        """A guessed token, the session's id as one, and none."""
        words = set()
        for name, rows in ROWS.items():
            request = rows[0].make(me, ids_of(me, other)[rows[0].kind]["own"])
            for token in (None, "guessed-guessed-guessed", str(me.session)):
                answer = me.answer(name, request, token=token)
                words.add(answer.words)
                self.check(f"{name} token", answer.code == "UNAUTHENTICATED", answer)
        self.check("one wording", len(words) == 1, *words)

    def lists(self, me, other):
        """Checks that lists have one's own things only."""
        scenes = me.ok("ListScenes", service.ListScenesRequest())[0].scenes
        mine = {scene.scene for scene in scenes}
        self.check("ListScenes", me.scene in mine and other.scene not in mine, mine)
        nearest = me.answer("OpenScene", [service.OpenSceneRequest(name=other.name[:-1])]).facts[1]
        self.check("nearest names", me.name in nearest and other.name not in nearest, nearest)
        used = [
            dict(each.ok("GetServerInfo", service.GetServerInfoRequest())[0].used)
            for each in (me, other)
        ]
        other.answer("UploadBlob", [upload_of(os.urandom(1 << 16))])
        later = [
            dict(each.ok("GetServerInfo", service.GetServerInfoRequest())[0].used)
            for each in (me, other)
        ]
        good = used[0] == later[0] and used[1] != later[1]
        self.check("used", good, used, later)


def main():
    with common.Report("S9 authorisation") as report, served.folder() as place:
        report.figure("calls without a row", len(set(METHODS) - set(ROWS)), 0)
        with served.served("--tenants", served.tenants_file(place)) as daemon:
            me, other = Caller(daemon, "robots"), Caller(daemon, "vision")
            matrix = Matrix()
            matrix.ids(me, other)
            matrix.sessions(me, other)
            matrix.tokens(me, other)
            matrix.lists(me, other)
            for line in matrix.wrong:
                print("   ", line)
            report.figure(f"of {matrix.cells} cells, wrong", len(matrix.wrong), 0)
            report.figure(
                "of the other's scenes, lost",
                other.answer(
                    "DescribeScene", [service.DescribeSceneRequest(scene=other.scene)]
                ).code
                != "OK",
                0,
            )


if __name__ == "__main__":
    main()
