"""What try_image asks of the daemon, from a container beside it.

usage: try_image.py render|keep|finish|endless|kept
"""

import pathlib
import sys

import heliograph as hg

ADDRESS = "unix:///run/heliograph/heliograph.sock"
CUBE = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"""


def stage(scene: hg.Scene) -> None:
    """A cube that the decoder read, and the camera "cam"."""
    path = pathlib.Path("/tmp/cube.obj")
    path.write_text(CUBE)
    with scene.edit() as edit:
        edit.sample_studio()
        edit.import_file(path, name="cube", up="z", units=1)
        lens = hg.Camera.from_fov(50, 256, 256, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0.5, -3, 2), (0.5, 0.5, 0.5)))


def render(client: hg.Client) -> None:
    with client.create_scene() as scene:
        stage(scene)
        frame = scene.render("cam", spp=16, planes=["beauty", "depth", "instance"])
        hits = int((frame["instance"] > 0).sum())
        assert frame["beauty"].mean() > 0.01 and hits > 5000, hits
        print(f"a frame of {frame['beauty'].shape}, {hits} pixels of labels")
    print("the decoder's sandbox goes without:", ", ".join(client.info().refused) or "nothing")


def keep(client: hg.Client) -> None:
    stage(client.create_scene("kept", lifetime="disk_synced"))


def finish(client: hg.Client) -> None:
    """A job that is under way when the daemon is told to end."""
    scene = client.open_scene("kept")
    print("begun", flush=True)
    frame = scene.render("cam", spp=1 << 20, seconds=6)
    print(f"a whole frame, mean {frame['beauty'].mean():.3f}")


def endless(client: hg.Client) -> None:
    """A job that the drain cuts off."""
    scene = client.open_scene("kept")
    print("begun", flush=True)
    try:
        scene.render("cam", spp=1 << 20, seconds=600)
    except hg.Unavailable as error:
        assert error.retry_seconds > 0
        print(f"cut off: {error}")
    else:
        sys.exit("not cut off")


def kept(client: hg.Client) -> None:
    scene = client.open_scene("kept")
    frame = scene.render("cam", spp=4)
    print(f"revision {scene.revision} of the scene is there, mean {frame['beauty'].mean():.3f}")


if __name__ == "__main__":
    step = {each.__name__: each for each in (render, keep, finish, endless, kept)}[sys.argv[1]]
    with hg.connect(ADDRESS) as client:
        step(client)
