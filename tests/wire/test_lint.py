"""The contract is as buf's STANDARD rules want it, but for what buf.yaml excepts and says why; and
each of its fields is commented and each of its numbers used or reserved."""

import contracts
import lint
import pytest

SETTINGS = lint.Settings((contracts.ROOT / "buf.yaml").read_text())


def of_ours(contract):
    return [f for f in contract.file if not any(f.name.startswith(i) for i in SETTINGS.ignored)]


@pytest.fixture(scope="module")
def files():
    return of_ours(contracts.today(comments=True))


def test_buf_is_asked_the_same():
    assert SETTINGS.use == ["STANDARD"] and set(SETTINGS.excepted) <= set(lint.RULES)
    assert not SETTINGS.without_reason


@pytest.mark.parametrize("name", lint.RULES)
def test_each_rule_holds_or_is_excepted(files, name):
    found = list(lint.RULES[name](files))
    if name in SETTINGS.excepted:
        assert found, f"{name} holds: buf.yaml needs no exception"
    else:
        assert not found, "\n".join(found)


def test_each_field_says_what_it_is(files):
    assert not list(lint.uncommented(files))


def test_no_number_is_left_open(files):
    assert not list(lint.gaps(files))


def spoil(contract, change):
    change({file.name.rpartition("/")[2]: file for file in contract.file})
    return of_ours(contract)


FAULTS = {
    "ENUM_VALUE_PREFIX": lambda f: setattr(f["types.proto"].enum_type[0].value[1], "name", "U8"),
    "ENUM_ZERO_VALUE_SUFFIX": lambda f: setattr(
        f["types.proto"].enum_type[0].value[0], "name", "D_TYPE_NONE"
    ),
    "FIELD_LOWER_SNAKE_CASE": lambda f: setattr(
        f["types.proto"].message_type[0].field[0], "name", "axisX"
    ),
    "IMPORT_USED": lambda f: f["types.proto"].dependency.append("heliograph/v1/errors.proto"),
    "PACKAGE_DIRECTORY_MATCH": lambda f: setattr(f["types.proto"], "package", "heliograph.v2"),
    "PACKAGE_VERSION_SUFFIX": lambda f: setattr(f["types.proto"], "package", "heliograph"),
    "PACKAGE_SAME_GO_PACKAGE": lambda f: setattr(f["types.proto"].options, "go_package", "x"),
    "RPC_PASCAL_CASE": lambda f: setattr(f["service.proto"].service[0].method[0], "name", "get"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_breach_is_found(name):
    assert list(lint.RULES[name](spoil(contracts.today(), FAULTS[name])))


def test_a_gap_and_a_missing_comment_are_found(files):
    bare = of_ours(contracts.today())  # without comments
    assert len(list(lint.uncommented(bare))) > 300
    contract = contracts.today()
    number = {"name": "z", "number": 9}
    grown = spoil(contract, lambda f: f["types.proto"].message_type[0].field.add(**number))
    assert any("lacks [3, 4, 5, 6, 7, 8]" in line for line in lint.gaps(grown))
