"""Versions of the contract as FileDescriptorSets, and message classes of each: N-1 is frozen in
golden/, N is proto/, N+1 is made of N. Used by the tests of version skew; needs no generated code.
"""

import pathlib
import subprocess
import tempfile

import grpc
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

ROOT = pathlib.Path(__file__).resolve().parents[2]
GOLDEN = pathlib.Path(__file__).resolve().parent / "golden"
PACKAGE = "heliograph.v1"
FUTURE_FIELD = 1999  # of every message of N+1, varint
FUTURE_CASE = 1998  # of every oneof's message of N+1, a message
FUTURE_VALUE = 999  # of every enum of N+1


def golden(name: str) -> descriptor_pb2.FileDescriptorSet:
    data = (GOLDEN / f"{name}.binpb").read_bytes()
    return descriptor_pb2.FileDescriptorSet.FromString(data)


def today(comments: bool = False) -> descriptor_pb2.FileDescriptorSet:
    """Descriptors of proto/ and its imports, by protoc."""
    protos = sorted((ROOT / "proto").rglob("*.proto"))
    flags = ["--include_imports", *(["--include_source_info"] if comments else [])]
    with tempfile.NamedTemporaryFile() as out:
        subprocess.check_call(
            ["protoc", f"-I{ROOT / 'proto'}", f"--descriptor_set_out={out.name}", *flags, *protos]
        )
        return descriptor_pb2.FileDescriptorSet.FromString(pathlib.Path(out.name).read_bytes())


def _grow_message(message: descriptor_pb2.DescriptorProto, name: str) -> None:
    if message.options.map_entry:
        return
    for nested in message.nested_type:
        _grow_message(nested, f"{name}.{nested.name}")
    for enum in message.enum_type:
        _grow_enum(enum)
    optional = descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL
    uint64 = descriptor_pb2.FieldDescriptorProto.TYPE_UINT64
    message.field.add(name="future", number=FUTURE_FIELD, label=optional, type=uint64)
    synthetic = {field.oneof_index for field in message.field if field.proto3_optional}
    for index, _ in enumerate(message.oneof_decl):
        if index not in synthetic:
            message.field.add(
                name="future_case",
                number=FUTURE_CASE,
                label=optional,
                type=descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE,
                type_name=f".{PACKAGE}.FutureRequest",
                oneof_index=index,
            )


def _grow_enum(enum: descriptor_pb2.EnumDescriptorProto) -> None:
    # Values of proto3's enums are siblings of their enum.
    enum.value.add(name=f"{enum.name.upper()}_FUTURE", number=FUTURE_VALUE)


def next_version(contract: descriptor_pb2.FileDescriptorSet) -> descriptor_pb2.FileDescriptorSet:
    """N+1: a field more in each message, a case in each oneof, a value in each enum, an RPC."""
    out = descriptor_pb2.FileDescriptorSet()
    out.CopyFrom(contract)
    for file in out.file:
        if file.package != PACKAGE:
            continue
        for message in file.message_type:
            _grow_message(message, message.name)
        for enum in file.enum_type:
            _grow_enum(enum)
        if file.name.endswith("types.proto"):
            file.message_type.add(name="FutureRequest")
        for service in file.service:
            kind = f".{PACKAGE}.FutureRequest"
            service.method.add(name="Future", input_type=kind, output_type=kind)
    return out


class Contract:
    """The messages and calls of one version."""

    def __init__(self, files: descriptor_pb2.FileDescriptorSet):
        self.pool = descriptor_pool.DescriptorPool()
        waiting = list(files.file)
        while waiting:  # a file after those that it imports
            known = {file.name for file in files.file} - {file.name for file in waiting}
            ready = next(file for file in waiting if known.issuperset(file.dependency))
            self.pool.Add(ready)
            waiting.remove(ready)
        self.service = self.pool.FindServiceByName(f"{PACKAGE}.Renderer")
        self.methods = self.service.methods_by_name

    def message(self, name: str, **fields):
        found = self.pool.FindMessageTypeByName(f"{PACKAGE}.{name}")
        return message_factory.GetMessageClass(found)(**fields)

    def value(self, enum: str, name: str) -> int:
        return self.pool.FindEnumTypeByName(f"{PACKAGE}.{enum}").values_by_name[name].number

    def request(self, method: str, **fields):
        found = self.methods[method].input_type
        return message_factory.GetMessageClass(found)(**fields)

    def callable(self, channel: grpc.Channel, method: str):
        """The callable of a method, on a channel."""
        found = self.methods[method]
        kind = ("stream" if found.client_streaming else "unary") + (
            "_stream" if found.server_streaming else "_unary"
        )
        return getattr(channel, kind)(
            f"/{PACKAGE}.Renderer/{method}",
            request_serializer=lambda message: message.SerializeToString(),
            response_deserializer=message_factory.GetMessageClass(found.output_type).FromString,
        )
