"""The record of a data set, DIR/.heliograph/dataset.json: the first run to make it owns the
directory, and any other run is the same or is refused. Used by generate() and its workers.

It appears whole, and for one of all runs that try: by a link to a free name, which network file
systems decide as well (NFSv3 and later). Locks are used besides, where machines share them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import hashlib
import json
import os
import shutil
from collections.abc import Container, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import FailedPrecondition
from .folder import NAME, Folder

if TYPE_CHECKING:
    from ..client.scene import Scene

FORMAT = "heliograph.dataset.v1"
_UNLIKE = ("count", "version", "numpy")  # keys in which runs of one data set may differ
_NO_LINKS = (errno.EPERM, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EXDEV)
_TAKEN = (errno.EEXIST, errno.ENOTEMPTY)


@contextlib.contextmanager
def claimed(records: Iterable[Record], scene: Scene, again: Container[int] = ()) -> Iterator[None]:
    """A run that has claimed all of these, or nothing. In one order for all, so that of two runs
    that want the same directories one gets the first. again: images that are not done any more."""
    ordered = sorted(records, key=lambda record: record.folder.root.resolve())
    with contextlib.ExitStack() as run:
        with contextlib.ExitStack() as drafts:
            scenes = [drafts.enter_context(record.drafted(scene)) for record in ordered]
            for record, path in zip(ordered, scenes):
                run.callback(record.leave)
                record.claim(path, again)
        yield


class Record:
    """Description that one run gives of its data set, beside the one in the directory. Thread: one
    at a time."""

    def __init__(self, folder: Folder, description: Mapping[str, Any]) -> None:
        self.folder = folder
        self.path = folder.own / "dataset.json"
        self._new = json.loads(json.dumps({"format": FORMAT, **description}, default=_plain))
        self._made = False

    @contextlib.contextmanager
    def drafted(self, scene: Scene) -> Iterator[Path]:
        """The file of the scene, whose hash the record has. FailedPrecondition where the
        directory is another data set's by now; then nothing was changed."""
        with self.folder.partial(self.folder.scene_path) as path:
            self.folder.drop_partial()
            scene.save(path)
            self._new["scene_sha256"] = _sha256(path)
            if self.path.exists():
                self._compare(self.folder.description)
            yield path

    def claim(self, scene_path: Path, again: Container[int]) -> None:
        """Begins the data set, or joins it if it is the same."""
        with self.folder.alone():
            self.folder.enter()
            if self.folder.has_images(but=again) and not self.path.exists():
                raise FailedPrecondition(
                    f"{self.folder.own}: has images of a data set, and not its dataset.json: copy "
                    "it, or make all images again with resume=False"
                )
            self._made = self._publish(self._new)
            self._compare(self.folder.description)
            with self.folder.explained(self.folder.scene_path):
                os.replace(scene_path, self.folder.scene_path)
            self.folder.forget(again)
            self.count()

    def leave(self) -> None:
        """Ends a run. Withdraws a data set that it began and that has no image yet, unless another
        run is under way."""
        with self.folder.alone():
            self.folder.exit()
            if self._made and not self.folder.has_files() and not self.folder.has_images():
                self._withdraw()

    def check(self) -> None:
        """FailedPrecondition where the directory has become another data set's since it was
        claimed, be it by another process."""
        old = self.folder.description
        new = {"scene_sha256": old.get("scene_sha256"), **self._new, "count": old.get("count")}
        self._compare(old, new)

    def count(self) -> int:
        """Raises the number of images to that of this run, if it is larger, and returns it. Call
        while alone()."""
        old = self.folder.description
        if self._new["count"] > old["count"]:
            self.folder.put(f"{NAME}/dataset.json", _text({**old, "count": self._new["count"]}))
        return int(max(self._new["count"], old["count"]))

    def _compare(self, old: dict[str, Any], new: dict[str, Any] | None = None) -> None:
        new = self._new if new is None else new
        root = self.folder.root
        if old.get("format") != new["format"] or not isinstance(old.get("count"), int):
            raise FailedPrecondition(
                f"{self.path}: is no record of this version ({old.get('format')!r}, not "
                f"{FORMAT!r}): write to another directory"
            )
        keys = (key for key in _differences(old, new) if key not in _UNLIKE)
        differs = ", ".join(key.removesuffix("_sha256") for key in keys)
        if differs:
            now, remedy = "", ", or remove this one"
            if self.folder.is_entered_here():
                now, remedy = ", and a run is making it", ""
            elif self.folder.is_entered():
                now = ", and a run is making it, or was killed on another machine"
            raise FailedPrecondition(
                f"{root} is a data set with another {differs}{now}: write to another directory"
                f"{remedy}"
            )
        if new["count"] < old["count"]:
            raise FailedPrecondition(
                f"{root} is a data set of {old['count']} images, count={new['count']} is less: "
                "ask for as many or more, or remove the directory"
            )

    # ------------------------------------------------------------ one of many

    def _publish(self, description: dict[str, Any]) -> bool:
        """Puts the record where there is none; False: there is one, or a lost reply hides that it
        is this one."""
        with self.folder.partial(self.path) as draft:
            draft.write_text(_text(description))
            try:
                os.link(draft, self.path)
            except FileExistsError:
                return False
            except OSError as error:
                if error.errno not in _NO_LINKS:
                    raise
                return self._publish_folder(draft)
            return True

    def _publish_folder(self, draft: Path) -> bool:
        """Publishes without hard links: a folder takes a name that no folder with files has. It is
        not withdrawn."""
        box, claim = draft.with_name(f"{draft.name}.box"), self.folder.own / "claim"
        box.mkdir()
        os.replace(draft, box / self.path.name)
        try:
            os.rename(box, claim)
        except OSError as error:
            shutil.rmtree(box)
            if error.errno not in _TAKEN:
                raise
        if not self.path.exists():
            shutil.copyfile(claim / self.path.name, draft)
            os.replace(draft, self.path)
        return False

    def _withdraw(self) -> None:
        """Takes the record back, unless somebody has entered by the time that it is gone."""
        gone_or_there = contextlib.suppress(FileNotFoundError, FileExistsError)
        with self.folder.partial("withdrawn") as old, gone_or_there:
            os.replace(self.path, old)
            if self.folder.is_entered():
                os.link(old, self.path)


def _text(description: Mapping[str, Any]) -> str:
    return json.dumps(description, indent=1) + "\n"


def _plain(value: Any) -> Any:
    """Plain value for JSON: the dict of a dataclass, else its repr()."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return repr(value)


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    """Keys with another value; of two objects in them "key.inner"."""
    for key in sorted({*old, *new}):
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict) and a.get("format") != b.get("format"):
            yield f"{key}.format"  # whose other settings are not the same ones
        elif isinstance(a, dict) and isinstance(b, dict):
            yield from (f"{key}.{inner}" for inner in _differences(a, b))
        elif a != b:
            yield key


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
