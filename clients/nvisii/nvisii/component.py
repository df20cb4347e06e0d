"""Base of all components: names, ids, users, and changes since the last picture."""

from __future__ import annotations

import heapq
from typing import Any, ClassVar, TypeVar

_C = TypeVar("_C", bound="Component")


class Component:
    """Base of all components: a named value in Python. render() sends the changes of shown ones.

    Names are unique per kind. Ids are the lowest free numbers, and are used again after remove().
    """

    _named: ClassVar[dict[str, Any]]
    _free: ClassVar[list[int]]
    _changed: ClassVar[dict[Any, None]]  # in order, so that the same script sends the same bytes
    _missing_raises: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        cls._named, cls._free, cls._changed = {}, [], {}

    def __init__(self, name: str) -> None:
        if not isinstance(name, str):
            raise RuntimeError(f"{self._kind()}.create: name is a str, not {name!r}")
        if name in self._named:
            raise RuntimeError(f'{self._kind()} "{name}" already exists; remove it, or get() it')
        self._name = name
        self._id = heapq.heappop(self._free) if self._free else len(self._named)
        self._users: dict[Component, None] = {}
        self._alive = True
        self._named[name] = self
        self.mark_dirty()

    @classmethod
    def _kind(cls) -> str:
        return cls.__name__

    # ------------------------------------------------------------ by name

    @classmethod
    def get(cls: type[_C], name: str) -> _C | None:
        """The component of that name, or None."""
        return cls._named.get(name)

    @classmethod
    def remove(cls, name: str) -> None:
        """Removes it; whatever used it is without it from then on."""
        found = cls._named.get(name)
        if found is not None:
            found._remove()
        elif cls._missing_raises:
            raise RuntimeError(f'{cls._kind()}.remove: there is no {cls._kind()} "{name}"')

    @classmethod
    def clear_all(cls) -> None:
        """Removes all of this kind."""
        for found in list(cls._named.values()):
            found._remove()

    def _remove(self) -> None:
        del self._named[self._name]
        heapq.heappush(self._free, self._id)
        if not self._named:
            self._free.clear()
        self._alive = False
        for user in list(self._users):
            user._lose(self)
        self._release()
        self.mark_dirty()

    def _release(self) -> None:
        """Gives up the components that this one uses."""

    def _lose(self, used: Component) -> None:
        """Something that this component uses was removed."""

    @classmethod
    def get_count(cls) -> int:
        """Number of components of this kind."""
        return len(cls._named)

    @classmethod
    def get_name_to_id_map(cls) -> dict[str, int]:
        """Name to id."""
        return {name: found._id for name, found in cls._named.items()}

    def get_name(self) -> str:
        return self._name

    def get_id(self) -> int:
        return self._id

    def to_string(self) -> str:
        """Kind and name, as JSON."""
        return f'{{\n"type": "{self._kind()}",\n"name": "{self._name}"\n}}\n'

    __repr__ = to_string

    def is_initialized(self) -> bool:
        """False once it was removed."""
        return self._alive

    # ------------------------------------------------------------ what changed

    @classmethod
    def are_any_dirty(cls) -> bool:
        """True if a component of this kind changed since the last picture."""
        return bool(cls._changed)

    def is_dirty(self) -> bool:
        return self in self._changed

    def is_clean(self) -> bool:
        return self not in self._changed

    def mark_dirty(self) -> None:
        self._changed[self] = None

    def mark_clean(self) -> None:
        self._changed.pop(self, None)

    # ------------------------------------------------------------ uses

    def _use(self, field: str, kind: type[Component], value: Any) -> None:
        """Sets a field to a component of a kind, or to None; both sides know."""
        check(field.lstrip("_"), kind, value)
        old = getattr(self, field)
        setattr(self, field, value)
        self._swap(old, value)

    def _swap(self, old: Component | None, new: Component | None) -> None:
        """A field that was `old` has become `new`."""
        if old is not None and old not in self._used():
            old._users.pop(self, None)
        if new is not None:
            new._users[self] = None
        self.mark_dirty()

    def _used(self) -> list[Component]:
        """Lists the components that this one uses."""
        return []


def check(field: str, kind: type[Component], value: Any) -> None:
    """Refuses any value but None and an existing component of that kind. RuntimeError."""
    if value is not None and not isinstance(value, kind):
        raise RuntimeError(f"{field}: needs a nvisii.{kind._kind()}, not {value!r}")
    if value is not None and not value._alive:
        raise RuntimeError(f'{field}: {kind._kind()} "{value._name}" was removed')
