"""The contract only grows, against the one that was frozen last."""

import breaking
import contracts
import pytest
from google.protobuf import descriptor_pb2


def test_nothing_breaks():
    found = breaking.breaks(contracts.golden("v1_latest"), contracts.today())
    assert not found, "the contract broke:\n" + "\n".join(found)


def test_what_is_added_breaks_nothing():
    contract = contracts.today()
    assert breaking.breaks(contract, contracts.next_version(contract)) == []
    gone = breaking.breaks(contracts.next_version(contract), contract)
    assert any("Renderer.Future: the call is gone" in line for line in gone)
    assert any("Edit.future_case" in line for line in gone)


def message_of(files, name):
    return next(m for file in files.file for m in file.message_type if m.name == name)


def enum_of(files, name):
    return next(e for file in files.file for e in file.enum_type if e.name == name)


def field_of(files, message, name):
    return next(f for f in message_of(files, message).field if f.name == name)


def call_of(files, name):
    return next(c for file in files.file for s in file.service for c in s.method if c.name == name)


def without(files, message, name, reserve):
    holder = message_of(files, message)
    gone = field_of(files, message, name)
    if reserve:
        holder.reserved_range.add(start=gone.number, end=gone.number + 1)
        holder.reserved_name.append(name)
    holder.field.remove(gone)


def into_oneof(files):
    field_of(files, "RenderRequest", "seed").oneof_index = 0


def change(path, **values):
    """A fault that sets attributes of what `path` finds."""

    def apply(files):
        for name, value in values.items():
            setattr(path(files), name, value)

    return apply


def seed(files):
    return field_of(files, "RenderRequest", "seed")


FAULTS = {
    "renumbered": (change(seed, number=77), "seed (field 12) is gone and not reserved"),
    "renamed": (change(seed, name="dice"), "field 12 is now called dice"),
    "retyped": (change(seed, type=descriptor_pb2.FieldDescriptorProto.TYPE_UINT32), "was uint64"),
    "made a list": (change(seed, label=3), "was optional, is repeated"),
    "into a oneof": (into_oneof, "changed its oneof"),
    "without presence": (
        lambda files: field_of(files, "RenderRequest", "spp").ClearField("proto3_optional"),
        "spp: field 13",
    ),
    "removed": (lambda f: without(f, "RenderRequest", "seed", False), "is gone and not reserved"),
    "value removed": (lambda f: enum_of(f, "DType").value.pop(), "D_TYPE_F64 (value 8) is gone"),
    "value renamed": (
        change(lambda f: enum_of(f, "DType").value[1], name="D_TYPE_BYTE"),
        "value 1 is now called D_TYPE_BYTE",
    ),
    "call gone": (change(lambda f: call_of(f, "Render"), name="Draw"), "Render: the call is gone"),
    "call streams": (
        change(lambda f: call_of(f, "Apply"), server_streaming=True),
        "Apply: server_streaming was False, is True",
    ),
    "message gone": (change(lambda f: message_of(f, "Vec2"), name="V2"), "v1.Vec2 is gone"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_break_is_found_and_named(fault):
    old, new = contracts.today(), contracts.today()
    spoil, line_part = FAULTS[fault]
    spoil(new)
    found = breaking.breaks(old, new)
    assert any(line_part in line for line in found), found
    assert all(line.endswith(breaking.REMEDY) for line in found)


def test_what_is_reserved_may_go_and_never_comes_back():
    old, new = contracts.today(), contracts.today()
    without(new, "RenderRequest", "seed", True)
    assert breaking.breaks(old, new) == []
    back = breaking.breaks(new, old)
    assert any("uses what was reserved" in line for line in back)
    assert any("reserved no longer" in line for line in back)
