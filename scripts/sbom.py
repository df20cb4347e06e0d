"""The contents of a bundle or a wheel, as CycloneDX 1.5 JSON. Used by scripts/bundle and
scripts/wheel.

Nothing is listed by hand: packages that brought the files inside (dpkg), packages whose headers
were compiled in by the build tree (Ninja), packages that pip unpacked, and sources that were
compiled in. A file of unknown origin ends the program.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import pathlib
import platform
import re
import subprocess
import sys
import urllib.parse
from collections.abc import Iterable
from typing import Any

PROGRAMS = "bin/heliographd", "bin/heliograph-decode", "bin/heliograph-dlpack.so"
# Debian's names of licences that SPDX calls otherwise.
SPDX = {
    "apache-2": "Apache-2.0",
    "apache-2.0": "Apache-2.0",
    "boost": "BSL-1.0",
    "bsd-2-clause": "BSD-2-Clause",
    "bsd-3-clause": "BSD-3-Clause",
    "bsd-3-clause~google": "BSD-3-Clause",
    "bsd-3-google": "BSD-3-Clause",
    "bsl-1": "BSL-1.0",
    "bsl-1.0": "BSL-1.0",
    "cc0": "CC0-1.0",
    "cc0-1.0": "CC0-1.0",
    "expat": "MIT",
    "gpl-2": "GPL-2.0-only",
    "gpl-2+": "GPL-2.0-or-later",
    "gpl-3+": "GPL-3.0-or-later",
    "isc": "ISC",
    "lgpl-2.1": "LGPL-2.1-only",
    "lgpl-2.1+": "LGPL-2.1-or-later",
    "lgpl-3+": "LGPL-3.0-or-later",
    "mit": "MIT",
    "zlib": "Zlib",
}
SYSTEM = {"libc6-dev", "linux-libc-dev"}  # interfaces of what stays the system's
GCC = "GPL-3.0-or-later WITH GCC-exception-3.1"


def output_of(*command: object) -> str:
    """Output of a command; ends this program when it fails."""
    done = subprocess.run([str(each) for each in command], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"sbom: failed: {' '.join(map(str, command))}")
    return done.stdout


def is_elf(path: pathlib.Path) -> bool:
    if not path.is_file() or path.is_symlink():
        return False
    with path.open("rb") as file:
        return file.read(4) == b"\x7fELF"


def owners(paths: Iterable[pathlib.Path]) -> dict[pathlib.Path, str]:
    """The package that brought each file, which may be listed without its /usr. Files of no package
    are left out."""
    listed = [text for path in paths for text in (str(path), str(path).removeprefix("/usr"))]
    found = subprocess.run(["dpkg", "-S", *listed], capture_output=True, text=True).stdout
    owner = {line.split(": ")[1]: line.split(":")[0] for line in found.splitlines()}
    known = {
        path: owner.get(str(path), owner.get(str(path).removeprefix("/usr"))) for path in paths
    }
    return {path: package for path, package in known.items() if package}


def versions_of(packages: Iterable[str]) -> dict[str, str]:
    text = output_of("dpkg-query", "-W", "-f", "${Package} ${Version}\n", *packages)
    return dict(line.split() for line in text.splitlines())


# ---------------------------------------------------------------- what was compiled in


def compiled_in(build: pathlib.Path) -> dict[str, str]:
    """Package -> "static" or "headers", for packages compiled into a tree's programs."""
    if not (build / "build.ninja").exists():
        sys.exit(f"sbom: {build} is no tree of Ninja, so the files compiled in are not known")
    ninja = "ninja", "-C", build.resolve(), "-t"
    inputs = output_of(*ninja, "inputs", *PROGRAMS).splitlines()
    objects = [line for line in inputs if line.endswith(".o") and not line.startswith("/")]
    headers = {
        pathlib.Path(line.strip()).resolve()
        for line in output_of(*ninja, "deps", *objects).splitlines()
        if line.startswith("    /usr/")
    }
    archives = {pathlib.Path(line).resolve() for line in inputs if re.match(r"/usr/.*\.a$", line)}
    if not headers:
        sys.exit(f"sbom: {build} has no record of headers: build it first")
    kinds = dict.fromkeys(owners(headers).values(), "headers")
    kinds |= dict.fromkeys(owners(archives).values(), "static")
    return {package: kind for package, kind in kinds.items() if package not in SYSTEM}


# ---------------------------------------------------------------- licences


def licences_of(package: str) -> list[dict[str, Any]]:
    """Licences of a package, from the part of its copyright file that covers its files at large."""
    text = pathlib.Path(f"/usr/share/doc/{package}/copyright").read_text(errors="replace")
    if "GCC Runtime Library Exception" in re.sub(r"\s+", " ", text):
        return [{"expression": GCC}]
    found = re.search(r"^Files: *\*\s*\n(?:(?!\n\s*\n)[\s\S])*?^License: *(.+)$", text, re.M)
    names = re.split(r" (and|or) ", found[1].strip()) if found else []
    known = [
        SPDX.get(name.lower(), name) if name not in ("and", "or") else name.upper()
        for name in names
    ]
    if names and all(name in ("AND", "OR") or name in SPDX.values() for name in known):
        return [{"expression": " ".join(known)}]
    name = found[1].strip() if found else "see its copyright file"
    return [{"license": {"name": f"{name} (licences/{package})"}}]


def licences_of_dist(dist: importlib.metadata.Distribution) -> list[dict[str, Any]]:
    about = dist.metadata
    if expression := about.get("License-Expression"):
        return [{"expression": expression}]
    names = [
        line.rpartition(" :: ")[2]
        for line in about.get_all("Classifier", [])
        if "License ::" in line
    ]
    line = (about.get("License") or "").strip()
    if "\n" not in line and line and not names:
        names = [line]
    return [{"license": {"name": name}} for name in names] or [
        {"license": {"name": "see its files"}}
    ]


# ---------------------------------------------------------------- the document


def file_component(path: pathlib.Path, name: str) -> dict[str, Any]:
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return {"type": "file", "name": name, "hashes": [{"alg": "SHA-256", "content": digest}]}


def debian_purl(package: str, version: str) -> str:
    release = platform.freedesktop_os_release()
    quoted = [urllib.parse.quote(text, safe="~") for text in (package, version)]
    architecture = output_of("dpkg", "--print-architecture").strip()
    return (
        f"pkg:deb/{release['ID']}/{quoted[0]}@{quoted[1]}"
        f"?arch={architecture}&distro={release['ID']}-{release['VERSION_ID']}"
    )


def component(name: str, version: str, purl: str, **more: Any) -> dict[str, Any]:
    return {
        "type": "library",
        "bom-ref": purl,
        "name": name,
        "version": version,
        "purl": purl,
        **more,
    }


class Sbom:
    """SBOM of the files below `stage`."""

    def __init__(self, stage: pathlib.Path, name: str, version: str) -> None:
        self._stage = stage
        self._left = {path for path in stage.rglob("*") if is_elf(path)}
        self._components: list[dict[str, Any]] = []
        self._own: dict[str, Any] = {
            "type": "application",
            "bom-ref": name,
            "name": name,
            "version": version,
            "licenses": [{"license": {"id": "Apache-2.0"}}],
        }

    def _files(self, paths: Iterable[pathlib.Path]) -> list[dict[str, Any]]:
        here = sorted(set(paths) & self._left)
        self._left.difference_update(here)
        return [file_component(path, str(path.relative_to(self._stage))) for path in here]

    def add_programs(self) -> None:
        """Adds this project's own programs."""
        self._own["components"] = self._files(self._stage / name for name in PROGRAMS)

    def add_packages(self, brought: dict[str, str], kinds: dict[str, str]) -> None:
        """brought: name of a library in lib/ -> the package that it is of; kinds: compiled_in()."""
        packages = kinds | dict.fromkeys(brought.values(), "shared")
        versions = versions_of(packages)
        for package, kind in sorted(packages.items()):
            files = [
                self._stage / "lib" / name for name, owner in brought.items() if owner == package
            ]
            more: dict[str, Any] = {
                "licenses": licences_of(package),
                "properties": [{"name": "heliograph:linkage", "value": kind}],
            }
            if inside := self._files(files):
                more["components"] = inside
            purl = debian_purl(package, versions[package])
            self._components.append(component(package, versions[package], purl, **more))

    def add_dist(
        self, dist: importlib.metadata.Distribution, files: Iterable[pathlib.Path]
    ) -> None:
        """A Python package, and which of its files are here."""
        name = re.sub(r"[-_.]+", "-", dist.metadata["Name"]).lower()
        more: dict[str, Any] = {"licenses": licences_of_dist(dist)}
        if inside := self._files(files):
            more["components"] = inside
        self._components.append(
            component(name, dist.version, f"pkg:pypi/{name}@{dist.version}", **more)
        )

    def add_source(self, name: str, version: str, licence: str, where: str) -> None:
        """Adds a library that was compiled in, with the archive of its sources."""
        purl = f"pkg:generic/{name}@{version}?download_url={urllib.parse.quote(where, safe='')}"
        more = {
            "licenses": [{"expression": licence}],
            "properties": [{"name": "heliograph:linkage", "value": "static"}],
        }
        self._components.append(component(name, version, purl, **more))

    def add_unpacked(self, folder: pathlib.Path) -> None:
        """Adds every distribution that pip unpacked in a folder."""
        for info in sorted(folder.glob("*.dist-info")):
            dist = importlib.metadata.Distribution.at(info)
            self.add_dist(dist, [folder / str(file) for file in dist.files or ()])

    def json(self) -> str:
        if self._left:
            names = ", ".join(str(path.relative_to(self._stage)) for path in sorted(self._left))
            sys.exit(f"sbom: nobody brought {names}")
        references = [each["bom-ref"] for each in self._components]
        document = {
            "bomFormat": "CycloneDX",
            "specVersion": "1.5",
            "version": 1,
            "metadata": {"component": self._own},
            "components": self._components,
            "dependencies": [{"ref": self._own["bom-ref"], "dependsOn": references}],
        }
        return json.dumps(document, indent=1) + "\n"


def moved(text: str, folder: str) -> str:
    """The document of files that lie in a folder of the archive now."""
    document = json.loads(text)
    for each in [document["metadata"]["component"], *document["components"]]:
        for file in each.get("components", ()):
            file["name"] = f"{folder}/{file['name']}"
    return json.dumps(document, indent=1) + "\n"
