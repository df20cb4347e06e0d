"""Parquet: tables of labels, for pandas, Polars, DuckDB or Spark. Needs the package pyarrow."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

import numpy as np

from ..._optional import pyarrow
from ..writer import Image, Picture, Records, Writer
from . import rows

_ROWS = 65536  # per row group, which is in memory at once


class Parquet(Writer):
    """DIR/images.parquet: a row per image; DIR/instances.parquet: a row per instance, with every
    label column but masks; DIR/keypoints.parquet: a row per keypoint, where there are any.

    `index` joins them, `label` the latter two. Vectors and matrices are lists, numbers as wide as
    in the label columns; values that are not finite are null. labels: as of Scene.render.
    picture: "png" or a Picture for images/000123.png too; without one nothing is shaded.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        labels: Any = True,
        picture: Picture | str | None = None,
    ) -> None:
        super().__init__(directory, picture=picture)
        pyarrow()
        self.planes = self.picture_planes
        self.labels = labels

    def write(self, image: Image) -> Any:
        file = self.put_picture(image) if self.picture else ""
        frame = image.frame
        shot = {
            **rows.picture_of(self.dataset, image),
            "seed": frame.seed,
            "samples": frame.samples,
        }
        for name in ("K", "camera_from_world_cv"):
            shot[name] = [number for row in shot[name] for number in row]
        instances = rows.instances_of(image, flat=True)
        for row in instances:
            row["attributes"] = [
                {"key": k, "value": v} for k, v in sorted(row["attributes"].items())
            ]
        record = {"types": _types_of(frame.labels), "images": [{**shot, "file": file}]}
        record["instances"] = [{"index": image.index, **row} for row in instances]
        if "keypoint_name" in frame.labels:
            points = rows.keypoints_of(image, flat=True)
            record["keypoints"] = [{"index": image.index, **row} for row in points]
        return record

    def finish(self, records: Records) -> None:
        first = next(iter(records))[1]
        for table in ("images", "instances", "keypoints"):
            if table in first:
                self._put(table, _schema(table, first["types"]), records)

    def _put(self, table: str, schema: Any, records: Records) -> None:
        arrow = pyarrow()
        with self.file(f"{table}.parquet") as path:
            out = arrow.parquet.ParquetWriter(path, schema, compression="zstd")
            with out:
                for chunk in _chunks(row for _, record in records for row in record[table]):
                    out.write_table(arrow.Table.from_pylist(chunk, schema))


def _chunks(every: Iterator[Any]) -> Iterator[list[Any]]:
    while True:
        chunk = list(islice(every, _ROWS))
        if not chunk:
            return
        yield chunk


def _types_of(labels: Mapping[str, Any]) -> dict[str, Any]:
    """Type of each label column: "str", or its dtype and the numbers per row."""
    return {
        name: "str" if isinstance(column, list) else [column.dtype.str, *_width(column)]
        for name, column in ((name, labels[name]) for name in labels)
    }


def _width(column: Any) -> list[int]:
    return [math.prod(column.shape[1:])] if column.ndim > 1 else []


def _schema(table: str, types: Mapping[str, Any]) -> Any:
    """Schema of a table, with the types of the label columns."""
    arrow = pyarrow()
    if table == "images":
        names: dict[str, Any] = {"split": "str", "camera": "str"}
        names.update(width=["<i4"], height=["<i4"])
        names.update(time=["<f8"], rolling=["<f8"])
        names.update(projection="str", distortion=["<f8", -1])
        names.update(K=["<f8", 9], camera_from_world_cv=["<f8", 16])
        names.update(seed=["<u8"], samples=["<u4"], file="str")
    elif table == "keypoints":
        own = {n[len("keypoint_") :]: t for n, t in types.items() if n.startswith("keypoint_")}
        names = {"label": own.pop("instance"), **own}
    else:
        names = {name: t for name, t in types.items() if rows.is_of_instances(name)}
        names["category_id"] = names.pop("category")
        names["category"] = "str"
    fields = {"index": arrow.int64(), **{n: _arrow_type(t) for n, t in names.items()}}
    if "attributes" in fields:
        pair = [("key", arrow.string()), ("value", arrow.string())]
        fields["attributes"] = arrow.list_(arrow.struct(pair))
    return arrow.schema(list(fields.items()))


def _arrow_type(type_of_column: Any) -> Any:
    arrow = pyarrow()
    if type_of_column == "str":
        return arrow.string()
    number = arrow.from_numpy_dtype(np.dtype(type_of_column[0]))
    return arrow.list_(number, type_of_column[1]) if len(type_of_column) > 1 else number
