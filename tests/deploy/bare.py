"""A root of its own, with the C library and what a test puts there."""

import pathlib
import re
import shutil
import subprocess

import pytest

ENTER = 'for at in proc dev; do mount --rbind /$at "$0/$at"; done && exec chroot "$0" "$@"'


def make_root(root):
    """Puts the libraries of libc6 into the folder `root`."""
    listed = subprocess.run(["dpkg", "-L", "libc6"], capture_output=True, text=True, check=True)
    for path in re.findall(r"^(?:/usr)?(/lib(?:64|/[^/]+)/[^/]+\.so\S*)$", listed.stdout, re.M):
        carry(root, pathlib.Path(path))
    for name in ("proc", "dev", "tmp", "run"):
        (root / name).mkdir()


def carry(root, path):
    """Copies a file of this system to where it is there, or to /lib what is in /usr/lib."""
    place = root / re.sub("^(/usr(?=/lib/))?/", "", str(path))
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(path, place)


def enter(root):
    """The command that runs a program of the root in it; skips where that is not allowed."""
    errors = ""
    for user in ([], ["--map-root-user"]):
        command = ["unshare", *user, "--mount", "sh", "-c", ENTER, root]
        done = subprocess.run(
            [*command, "/lib64/ld-linux-x86-64.so.2", "--version"], capture_output=True, text=True
        )
        if done.returncode == 0:
            return command
        errors += done.stderr
    pytest.skip(f"no root of one's own can be entered here: {errors}")
