"""A proxy before a real daemon that speaks the next version: each message of each reply, however
deep, has a field that today's clients do not know."""

import contextlib
import os
import pathlib
import sys
import tempfile
from concurrent import futures

import grpc
from google.protobuf import message_factory

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "wire"))
import contracts


def extend(message) -> None:
    """Sets the field of the future in a message and all beneath it."""
    if "future" not in message.DESCRIPTOR.fields_by_name:
        return  # google.rpc.Status, google.protobuf.Any
    message.future = 1 << 40
    for field, value in message.ListFields():
        if field.message_type is None or field.message_type.GetOptions().map_entry:
            continue
        for each in [value] if hasattr(value, "ListFields") else value:
            extend(each)


class Proxy(grpc.GenericRpcHandler):
    """Hands every call on, as bytes."""

    def __init__(self, target: str, min_api: int):
        self.min_api = min_api
        self.channel = grpc.insecure_channel(
            target, options=[("grpc.max_receive_message_length", -1)]
        )
        self.contract = contracts.Contract(contracts.next_version(contracts.today()))
        self.calls = set()

    def service(self, details):
        method = details.method.rpartition("/")[2]
        self.calls.add(method)
        reply = message_factory.GetMessageClass(self.contract.methods[method].output_type)

        def handle(requests, context):
            metadata = [(k, v) for k, v in context.invocation_metadata() if k != "user-agent"]
            call = self.channel.stream_stream(details.method)(requests, metadata=metadata)
            context.add_callback(call.cancel)
            try:
                for data in call:
                    message = reply.FromString(data)
                    if method != "ExportScene":  # that is a file, which comes back as a request
                        extend(message)
                    if method == "OpenSession":
                        message.server.min_api, message.server.max_api = self.min_api, 3
                        message.server.capabilities.remove("quick_calls")  # they pass by a proxy
                    yield message.SerializeToString()
            except grpc.RpcError as error:
                context.set_trailing_metadata(error.trailing_metadata() or ())
                context.abort(error.code(), error.details())

        return grpc.stream_stream_rpc_method_handler(handle)


@contextlib.contextmanager
def before(address: str, min_api: int = 1):
    """(address of a proxy, Proxy) before the daemon at unix:///path, which speaks versions min_api
    to 3; the local channel is the daemon's own."""
    path = address.removeprefix("unix://")
    with tempfile.TemporaryDirectory(prefix="hg-") as folder:
        os.symlink(path + ".fd.sock", f"{folder}/h.sock.fd.sock")
        proxy = Proxy(address, min_api)
        server = grpc.server(futures.ThreadPoolExecutor(32), handlers=[proxy])
        server.add_insecure_port(f"unix://{folder}/h.sock")
        server.start()
        try:
            yield f"unix://{folder}/h.sock", proxy
        finally:
            server.stop(0).wait()
            proxy.channel.close()
