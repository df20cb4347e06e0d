"""The rules of `buf lint` for STANDARD (https://buf.build/docs/lint/rules), by their ids, for a
FileDescriptorSet with its comments; and what of them buf.yaml excepts. Used by test_lint.py.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import PurePosixPath

import yaml
from google.protobuf import descriptor_pb2 as pb

Lines = Iterator[str]
RULES: dict[str, Callable[[list[pb.FileDescriptorProto]], Lines]] = {}
PASCAL = re.compile(r"[A-Z][A-Za-z0-9]*")
LOWER_SNAKE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
UPPER_SNAKE = re.compile(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*")
OPTIONS = {
    "CSHARP_NAMESPACE": "csharp_namespace",
    "GO_PACKAGE": "go_package",
    "JAVA_MULTIPLE_FILES": "java_multiple_files",
    "JAVA_PACKAGE": "java_package",
    "PHP_NAMESPACE": "php_namespace",
    "RUBY_PACKAGE": "ruby_package",
    "SWIFT_PREFIX": "swift_prefix",
}


class Settings:
    """The lint section of buf.yaml."""

    def __init__(self, text: str):
        lint = yaml.safe_load(text)["lint"]
        self.use, self.excepted = lint["use"], lint["except"]
        self.ignored = [path.removeprefix("proto/") for path in lint["ignore"]]
        self.without_reason, has_reason = [], False
        for line in map(str.strip, text[: text.index("ignore:")].splitlines()):
            if line[2:] in self.excepted and not has_reason:
                self.without_reason.append(line[2:])
            has_reason = line.startswith("#") or (has_reason and line[2:] in self.excepted)


def rule(function):
    RULES[function.__name__] = function
    return function


def rule_of_files(function):
    """Makes a rule that is checked for each file by itself."""

    def check(files: list[pb.FileDescriptorProto]) -> Lines:
        for file in files:
            yield from (f"{file.name}: {line}" for line in function(file))

    RULES[function.__name__] = check
    return check


def messages(holder) -> Iterator[pb.DescriptorProto]:
    is_file = isinstance(holder, pb.FileDescriptorProto)
    for message in holder.message_type if is_file else holder.nested_type:
        if not message.options.map_entry:
            yield message
            yield from messages(message)


def enums(file) -> Iterator[pb.EnumDescriptorProto]:
    for holder in (file, *messages(file)):
        yield from holder.enum_type


def fields(file) -> Iterator[tuple[str, pb.FieldDescriptorProto]]:
    for message in messages(file):
        yield from ((f"{message.name}.{field.name}", field) for field in message.field)


def calls(file) -> Iterator[pb.MethodDescriptorProto]:
    for service in file.service:
        yield from service.method


def misspelt(names, pattern) -> Lines:
    yield from (f"{name} is no {pattern.pattern}" for name in names if not pattern.fullmatch(name))


def last(type_name: str) -> str:
    return type_name.rpartition(".")[2]


# ---------------------------------------------------------------- packages and files


@rule_of_files
def PACKAGE_DEFINED(file):
    if not file.package:
        yield "has no package"


@rule_of_files
def PACKAGE_DIRECTORY_MATCH(file):
    if str(PurePosixPath(file.name).parent) != file.package.replace(".", "/"):
        yield f"is not where the package {file.package} belongs"


@rule
def DIRECTORY_SAME_PACKAGE(files):
    found: dict[PurePosixPath, set[str]] = {}
    for file in files:
        found.setdefault(PurePosixPath(file.name).parent, set()).add(file.package)
    yield from (f"{place}: {sorted(names)}" for place, names in found.items() if len(names) > 1)


@rule
def PACKAGE_SAME_DIRECTORY(files):
    found: dict[str, set[PurePosixPath]] = {}
    for file in files:
        found.setdefault(file.package, set()).add(PurePosixPath(file.name).parent)
    yield from (f"{name} is in {sorted(map(str, at))}" for name, at in found.items() if len(at) > 1)


@rule
def PACKAGE_NO_IMPORT_CYCLE(files):
    package = {file.name: file.package for file in files}
    needs: dict[str, set[str]] = {}
    for file in files:
        there = {package[name] for name in file.dependency if name in package}
        needs.setdefault(file.package, set()).update(there - {file.package})
    for start in needs:
        seen, todo = set(), list(needs[start])
        while todo:
            name = todo.pop()
            todo += needs.get(name, set()) - seen
            seen.add(name)
        if start in seen:
            yield f"{start} imports itself"


@rule_of_files
def PACKAGE_LOWER_SNAKE_CASE(file):
    yield from misspelt(file.package.split("."), LOWER_SNAKE)


@rule_of_files
def PACKAGE_VERSION_SUFFIX(file):
    if not re.search(r"\.v\d+((alpha|beta)\d*)?$", file.package):
        yield f"the package {file.package} has no version"


def _same_option(name: str, option: str) -> None:
    def check(files):
        found: dict[str, set] = {}
        for file in files:
            found.setdefault(file.package, set()).add(getattr(file.options, option))
        yield from (f"{package}: {values}" for package, values in found.items() if len(values) > 1)

    RULES[f"PACKAGE_SAME_{name}"] = check


for _name, _option in OPTIONS.items():
    _same_option(_name, _option)


@rule_of_files
def FILE_LOWER_SNAKE_CASE(file):
    yield from misspelt([PurePosixPath(file.name).stem], LOWER_SNAKE)


@rule_of_files
def SYNTAX_SPECIFIED(file):
    if not file.syntax:
        yield "says no syntax"


@rule_of_files
def IMPORT_NO_PUBLIC(file):
    yield from (f"imports {file.dependency[i]} publicly" for i in file.public_dependency)


@rule
def IMPORT_USED(files):
    gives = {file.name: file for file in files}
    for file in files:
        used = {field.type_name for _, field in fields(file)}
        used |= {name for call in calls(file) for name in (call.input_type, call.output_type)}
        for name in set(file.dependency) - {file.dependency[i] for i in file.public_dependency}:
            if name in gives and not used & _defines(gives[name]):
                yield f"{file.name}: {name} is not used"


def _defines(file) -> set[str]:
    found = set()

    def walk(prefix, holder):
        nested = holder.message_type if prefix == f".{file.package}" else holder.nested_type
        found.update(f"{prefix}.{enum.name}" for enum in holder.enum_type)
        for message in nested:
            found.add(f"{prefix}.{message.name}")
            walk(f"{prefix}.{message.name}", message)

    walk(f".{file.package}", file)
    return found


# ---------------------------------------------------------------- enums


@rule_of_files
def ENUM_PASCAL_CASE(file):
    yield from misspelt((enum.name for enum in enums(file)), PASCAL)


@rule_of_files
def ENUM_FIRST_VALUE_ZERO(file):
    yield from (f"{e.name} does not begin with 0" for e in enums(file) if e.value[0].number)


@rule_of_files
def ENUM_NO_ALLOW_ALIAS(file):
    yield from (f"{enum.name} has aliases" for enum in enums(file) if enum.options.allow_alias)


@rule_of_files
def ENUM_VALUE_UPPER_SNAKE_CASE(file):
    yield from misspelt((value.name for enum in enums(file) for value in enum.value), UPPER_SNAKE)


@rule_of_files
def ENUM_VALUE_PREFIX(file):
    for enum in enums(file):
        # As buf's: a word begins at a capital that follows a small letter or comes before one.
        words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", enum.name)
        for value in enum.value:
            if not value.name.startswith(f"{words.upper()}_"):
                yield f"{value.name} does not begin with {words.upper()}_"


@rule_of_files
def ENUM_ZERO_VALUE_SUFFIX(file):
    for enum in enums(file):
        if not enum.value[0].name.endswith("_UNSPECIFIED"):
            yield f"{enum.value[0].name} does not end with _UNSPECIFIED"


# ---------------------------------------------------------------- messages


@rule_of_files
def MESSAGE_PASCAL_CASE(file):
    yield from misspelt((message.name for message in messages(file)), PASCAL)


@rule_of_files
def FIELD_LOWER_SNAKE_CASE(file):
    yield from misspelt((field.name for _, field in fields(file)), LOWER_SNAKE)


@rule_of_files
def FIELD_NOT_REQUIRED(file):
    required = pb.FieldDescriptorProto.LABEL_REQUIRED
    yield from (f"{name} is required" for name, field in fields(file) if field.label == required)


@rule_of_files
def ONEOF_LOWER_SNAKE_CASE(file):
    for message in messages(file):
        synthetic = {field.oneof_index for field in message.field if field.proto3_optional}
        cases = [o.name for i, o in enumerate(message.oneof_decl) if i not in synthetic]
        yield from misspelt(cases, LOWER_SNAKE)


@rule_of_files
def PROTOVALIDATE(file):
    yield from (f"{name} has rules" for name in file.dependency if name.startswith("buf/validate/"))


# ---------------------------------------------------------------- services


@rule_of_files
def SERVICE_PASCAL_CASE(file):
    yield from misspelt((service.name for service in file.service), PASCAL)


@rule_of_files
def SERVICE_SUFFIX(file):
    for service in file.service:
        if not service.name.endswith("Service"):
            yield f"{service.name} does not end with Service"


@rule_of_files
def RPC_PASCAL_CASE(file):
    yield from misspelt((call.name for call in calls(file)), PASCAL)


@rule_of_files
def RPC_REQUEST_STANDARD_NAME(file):
    for call in calls(file):
        if last(call.input_type) != f"{call.name}Request":
            yield f"{call.name} takes {last(call.input_type)}"


@rule_of_files
def RPC_RESPONSE_STANDARD_NAME(file):
    for call in calls(file):
        if last(call.output_type) != f"{call.name}Response":
            yield f"{call.name} gives {last(call.output_type)}"


@rule
def RPC_REQUEST_RESPONSE_UNIQUE(files):
    found: dict[str, list[str]] = {}
    for call in (call for file in files for call in calls(file)):
        for name in (call.input_type, call.output_type):
            found.setdefault(last(name), []).append(call.name)
    yield from (f"{name} is of {users}" for name, users in found.items() if len(users) > 1)


# ---------------------------------------------------------------- ours


def uncommented(files: list[pb.FileDescriptorProto]) -> Lines:
    """Fields that no comment stands above or behind."""
    for file in files:
        commented = {
            tuple(place.path)
            for place in file.source_code_info.location
            if place.leading_comments or place.trailing_comments
        }

        def walk(prefix, path, message, commented=commented, name=file.name):
            for i, field in enumerate(message.field):
                if (*path, 2, i) not in commented:
                    yield f"{name}: {prefix}.{field.name}"
            for i, nested in enumerate(message.nested_type):
                if not nested.options.map_entry:
                    yield from walk(f"{prefix}.{nested.name}", (*path, 3, i), nested)

        for i, message in enumerate(file.message_type):
            yield from walk(message.name, (4, i), message)


def gaps(files: list[pb.FileDescriptorProto]) -> Lines:
    """Numbers below the highest one of a message that neither a field has nor anyone may."""
    for file in files:
        for message in messages(file):
            taken = {field.number for field in message.field}
            for range_ in message.reserved_range:
                taken |= set(range(range_.start, range_.end))
            missing = sorted(set(range(1, max(taken, default=0) + 1)) - taken)
            if missing:
                yield f"{file.name}: {message.name} lacks {missing}"
