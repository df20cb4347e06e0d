"""mat2 .. mat4: m[column][row], as in GLM; `m * n` and `m * v` are matrix products."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from ..checks import array
from .quaternions import quat, rotation_of
from .vectors import BY_SIZE, Numbers, Numeric


class Matrix(Numeric):
    """A square matrix of columns. Made of nothing or a number (times the identity), of columns, of
    all numbers column by column, of another matrix, or of nested sequences [column][row]."""

    size: ClassVar[int]
    __slots__ = ("_columns",)
    _columns: list[Any]
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, *values: Any) -> None:
        n = self.size
        if not values or (len(values) == 1 and np.ndim(values[0]) == 0):
            columns = np.eye(n) * (float(values[0]) if values else 1.0)
        elif len(values) == 1 and isinstance(values[0], quat):
            columns = np.eye(n)
            columns[:3, :3] = rotation_of(values[0]).T
        elif len(values) == 1:
            columns = np.eye(n)
            given = _numbers(values[0], type(self).__name__)
            given = given.reshape(n, n) if given.size == n * n else given
            if given.ndim != 2 or given.shape[0] != given.shape[1]:
                raise RuntimeError(f"{type(self).__name__}: needs {n}x{n}, not {given.shape}")
            k = min(n, len(given))
            columns[:k, :k] = given[:k, :k]
        else:
            given = _numbers(values, type(self).__name__)
            if given.size != n * n:
                raise RuntimeError(f"{type(self).__name__}: has {n * n} numbers, not {given.size}")
            columns = given.reshape(n, n)
        self._columns = [BY_SIZE[n](*column) for column in columns.tolist()]

    @classmethod
    def of(cls, matrix: Any) -> Any:
        """Makes a matrix from an array [row][column]."""
        made = cls.__new__(cls)
        columns = np.asarray(matrix, dtype=float).T.tolist()
        made._columns = [BY_SIZE[cls.size](*column) for column in columns]
        return made

    @property
    def rows(self) -> Any:
        """(N, N) float64 array [row][column]."""
        return np.array([column._values for column in self._columns]).T

    def __len__(self) -> int:
        return self.size

    def __iter__(self) -> Iterator[Any]:
        return iter(self._columns)

    def __getitem__(self, column: Any) -> Any:
        return self._columns[column]

    def __setitem__(self, column: int, values: Numbers) -> None:
        self._columns[column] = BY_SIZE[self.size](values)

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array([list(column) for column in self._columns], dtype=dtype)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Matrix):
            return NotImplemented
        return self._columns == other._columns

    def __repr__(self) -> str:
        columns = ", ".join(
            "(" + ", ".join(f"{v:f}" for v in column) + ")" for column in self._columns
        )
        return f"{type(self).__name__}({columns})"

    def __mul__(self, other: Any) -> Any:
        if np.ndim(other) == 0:
            return type(self).of(self.rows * other)
        if isinstance(other, Matrix):
            return type(self).of(self.rows @ other.rows)
        if len(other) != self.size:
            return NotImplemented
        return BY_SIZE[self.size](*(self.rows @ np.array(list(other), dtype=float)).tolist())

    def __rmul__(self, other: Any) -> Any:
        if np.ndim(other) == 0:
            return type(self).of(self.rows * other)
        return BY_SIZE[self.size](*(np.array(list(other), dtype=float) @ self.rows).tolist())

    def __add__(self, other: Any) -> Any:
        return type(self).of(self.rows + _rows(other))

    def __sub__(self, other: Any) -> Any:
        return type(self).of(self.rows - _rows(other))

    def __truediv__(self, other: float) -> Any:
        return type(self).of(self.rows / other)

    def __neg__(self) -> Any:
        return type(self).of(-self.rows)


def _rows(value: Any) -> Any:
    return value.rows if isinstance(value, Matrix) else value


def _numbers(values: Any, name: str) -> Any:
    try:
        return np.asarray([np.asarray(v, dtype=float) for v in values], dtype=float)
    except (TypeError, ValueError):
        raise RuntimeError(f"{name}: not numbers: {values!r}") from None


def _matrix(size: int) -> Any:
    members = {
        "__slots__": (),
        "__doc__": f"{size} columns of {size} numbers.",
        "__module__": __name__,
        "size": size,
    }
    return type(f"mat{size}", (Matrix,), members)


mat2, mat3, mat4 = (_matrix(n) for n in (2, 3, 4))


def rows_of(value: Any, size: int, name: str) -> Any:
    """(size, size) float64 [row][column], finite, of a matrix or of nested sequences
    [column][row]."""
    if isinstance(value, Matrix) and value.size == size:
        return array(name, value.rows)
    given = array(name, _numbers(value, name))
    if given.shape != (size, size):
        raise RuntimeError(f"{name}: needs a mat{size}, has shape {given.shape}")
    return given.T
