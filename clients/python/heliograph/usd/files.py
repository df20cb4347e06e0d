"""Files that a stage names: textures, in packages too. Needs pxr."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from pxr import Ar


class Files:
    """Reads beneath some folders only; files in a .usdz are copied to a folder of their own."""

    def __init__(self, stage: Path, folders: Sequence[Path]) -> None:
        self._folders = [stage.resolve().parent, *(folder.resolve() for folder in folders)]
        self._unpacked = tempfile.TemporaryDirectory(prefix="heliograph-usd-")
        self._members: dict[str, Path] = {}

    def close(self) -> None:
        """Removes the copies."""
        self._unpacked.cleanup()

    def found(self, authored: str, resolved: str) -> tuple[Path | None, str]:
        """The file of an asset path, or None and why there is none."""
        if not resolved:
            return None, f"the file {authored!r} is not there"
        if not Ar.IsPackageRelativePath(resolved):
            return self._allowed(Path(resolved))
        outer, inner = Ar.SplitPackageRelativePathOuter(resolved)
        package, why = self._allowed(Path(outer))
        if package is None or "[" in inner:
            return None, why or f"{authored!r} is in a package within a package"
        return self._member(package, inner)

    def _allowed(self, file: Path) -> tuple[Path | None, str]:
        real = file.resolve()
        if not real.is_file():
            return None, f"{file} is no file"
        if any(folder in real.parents for folder in self._folders):
            return real, ""
        return None, f"{file} is outside the stage's folder: give folders=[{str(file.parent)!r}]"

    def _member(self, package: Path, inner: str) -> tuple[Path | None, str]:
        key = f"{package}[{inner}]"
        if key not in self._members:
            suffix = PurePosixPath(inner).suffix[:8]
            target = Path(self._unpacked.name) / f"{len(self._members)}{suffix}"
            try:
                with zipfile.ZipFile(package) as archive, target.open("wb") as copy:
                    shutil.copyfileobj(archive.open(inner), copy)
            except (KeyError, OSError, zipfile.BadZipFile) as error:
                return None, f"{inner} of {package.name} cannot be read: {error}"
            self._members[key] = target
        return self._members[key], ""
