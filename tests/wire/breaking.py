"""Breaking changes of the contract: clients and scene files of the older version no longer mean
what they meant. A field may be added, a message, an enum value, a call; nothing else."""

from google.protobuf import descriptor_pb2

Field = descriptor_pb2.FieldDescriptorProto
REMEDY = "; take it back: add another field, and reserve number and name of one that goes"


def _index(files):
    """Full name -> descriptor, of messages (nested ones too), enums and services."""
    found = {}

    def walk(prefix, message):
        name = f"{prefix}.{message.name}"
        found[name] = message
        for nested in message.nested_type:
            walk(name, nested)
        for enum in message.enum_type:
            found[f"{name}.{enum.name}"] = enum

    for file in files.file:
        for message in file.message_type:
            walk(file.package, message)
        for other in (*file.enum_type, *file.service):
            found[f"{file.package}.{other.name}"] = other
    return found


def _reserved(holder, number):
    """Ranges of messages end before their end, those of enums with it."""
    past = 0 if isinstance(holder, descriptor_pb2.DescriptorProto) else 1
    return any(r.start <= number < r.end + past for r in holder.reserved_range)


def _removed(name, holder, number, kind):
    if not _reserved(holder, number) or name.rpartition(".")[2] not in holder.reserved_name:
        yield f"{name} ({kind} {number}) is gone and not reserved"


def _oneof(message, field):
    """The name of the oneof that a field is a case of; "optional" is none."""
    if not field.HasField("oneof_index") or field.proto3_optional:
        return ""
    return message.oneof_decl[field.oneof_index].name


def _type(field):
    if field.type_name:
        return field.type_name.lstrip(".")
    return Field.Type.Name(field.type).removeprefix("TYPE_").lower()


def _presence(field):
    return field.proto3_optional or field.HasField("oneof_index")


def _fields(name, old, new):
    now = {field.number: field for field in new.field}
    for field in old.field:
        path = f"{name}.{field.name}"
        other = now.get(field.number)
        if other is None:
            yield from _removed(path, new, field.number, "field")
            continue
        if other.name != field.name:
            yield f"{path}: field {field.number} is now called {other.name}"
        if _type(other) != _type(field):
            yield f"{path}: field {field.number} was {_type(field)}, is {_type(other)}"
        if other.label != field.label:
            labels = [Field.Label.Name(f.label).removeprefix("LABEL_") for f in (field, other)]
            yield f"{path}: field {field.number} was {labels[0].lower()}, is {labels[1].lower()}"
        if _oneof(new, other) != _oneof(old, field):
            yield f"{path}: field {field.number} changed its oneof"
        elif _presence(other) != _presence(field):
            yield f"{path}: field {field.number}: absent and zero differ in one version only"
    for field in new.field:
        if _reserved(old, field.number) or field.name in old.reserved_name:
            yield f"{name}.{field.name}: field {field.number} uses what was reserved"
    for taken in old.reserved_range:
        if not _reserved(new, taken.start):
            yield f"{name}: {taken.start} is reserved no longer"


def _values(name, old, new):
    now = {value.number: value.name for value in new.value}
    for value in old.value:
        path = f"{name}.{value.name}"
        if value.number not in now:
            yield from _removed(path, new, value.number, "value")
        elif now[value.number] != value.name:
            yield f"{path}: value {value.number} is now called {now[value.number]}"


def _calls(name, old, new):
    now = {method.name: method for method in new.method}
    for method in old.method:
        path, other = f"{name}.{method.name}", now.get(method.name)
        if other is None:
            yield f"{path}: the call is gone"
            continue
        for what in ("input_type", "output_type", "client_streaming", "server_streaming"):
            before, after = getattr(method, what), getattr(other, what)
            if before != after:
                yield f"{path}: {what} was {before}, is {after}"


def breaks(old, new):
    """One line for each thing that `new` breaks of `old`; both FileDescriptorSets."""
    before, after = _index(old), _index(new)
    lines = []
    for name, holder in before.items():
        other = after.get(name)
        if type(other) is not type(holder):
            lines.append(f"{name} is gone")
        elif isinstance(holder, descriptor_pb2.DescriptorProto):
            lines += _fields(name, holder, other)
        elif isinstance(holder, descriptor_pb2.EnumDescriptorProto):
            lines += _values(name, holder, other)
        else:
            lines += _calls(name, holder, other)
    return [line + REMEDY for line in lines]
