"""Scene: edits, renders, reads and queries of one scene."""

from __future__ import annotations

import difflib
import os
import uuid
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import service_pb2 as service
from .._wire._proto import types_pb2 as types
from .._wire.arrays import Columns, NdArray, filled
from ..errors import Aborted, HeliographError, InvalidArgument, NotFound
from ..render import batch, call, live
from ..render import watch as _watch
from ..render.frame import Frame
from ..render.worlds import WorldFrame, Worlds
from ..scene import query
from ..scene.handles import KINDS, Handle, Named, flatten
from .edit import Edits
from .lifetime import NAMES, Lifetime, lifetime_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .client import Client


class Overlay(Edits):
    """Edits for scene.render(overlay=...) only: the scene is never changed."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, publish=False)


class Scene:
    """A scene of a daemon. Thread: any; edits of one scene go out in one order.

    In a `with`, a private scene that this client made is deleted at the end.
    """

    def __init__(self, client: Client, id: int, name: str = "", *, owned: bool = False) -> None:
        self.client = client
        self.id = id
        self.name = name
        self._owned = owned

    # ------------------------------------------------------------ edits

    def edit(self, *, expected_revision: int | None = None) -> Edits:
        """`with scene.edit() as edit:` one atomic transaction, sent at the end of the block.

        expected_revision: Aborted when the scene has moved on from it.
        """
        return Edits(self, publish=True, expected_revision=expected_revision)

    def overlay(self) -> Overlay:
        """`with scene.overlay() as o:` edits that scene.render(overlay=o) applies for itself."""
        return Overlay(self)

    def apply(
        self, transaction: pb.Transaction, expected_revision: int | None = None
    ) -> service.ApplyReply:
        """Sends a transaction under the next number. A repetition is answered, not done twice."""
        request = service.ApplyRequest(
            scene=self.id, transaction=transaction, expected_revision=expected_revision
        )
        state = self.client.state_of(self.id)
        with state.lock:
            session = self.client.connection.link.session
            if state.session != session:
                state.session, state.next = session, self._info().next_edit
            request.number = state.next
            try:
                return self._send(request)
            except Aborted as error:
                if error.field != "number":
                    raise
                state.next = request.number = error.expected  # nothing of ours has that number
                return self._send(request)
            except HeliographError:
                state.session = 0  # its number may be free, or a reply was lost before: ask
                raise
            finally:
                state.next = request.number + 1

    def _send(self, request: service.ApplyRequest) -> service.ApplyReply:
        try:
            return self.client.connection.apply(request)
        except KeyboardInterrupt:
            # Sends the same number again, which settles if it was applied.
            self.client.connection.apply(request)
            raise

    # ------------------------------------------------------------ rendering

    def render(self, cameras: Any, **options: Unpack[call.Options]) -> Any:
        """Renders one camera (a Frame) or a sequence of them (a list of Frames).

        The stop rule of `beauty` and other averaged planes: spp, seconds and noise, any of them;
        without one, 64 samples per pixel. adaptive: samples go to the noisier tiles, up to
        spp per pixel. planes: names, default ["beauty"]; disparity:CAMERA names its second camera.
        half: names of planes to send as float16. size: (width, height), default the camera's own.
        seed. time: seconds, default the scene's. frame_interval, hold: the other end of flow.
        overlay: of scene.overlay(). labels: see docs/python.md; by default boxes come with any
        plane that looks at surfaces. revision: exactly this one. progress: bool or a callable.
        Ctrl-C cancels the job and leaves the client usable.
        """
        single = isinstance(cameras, (str, Handle))
        listed = flatten(cameras, "cameras")
        frames = call.render(self, listed, options)
        return frames[0] if single else frames

    def render_worlds(
        self, cameras: Any, worlds: Worlds, *, mask: Any = None, **options: Unpack[call.Options]
    ) -> WorldFrame:
        """Renders hg.Worlds of this scene in one call, packed: (R, C, H, W, channels) for the R
        worlds where mask (N,) is not 0, by default all, and C cameras. Options are those of
        render() but seconds, noise, adaptive and on_pass; world i has a seed of its own."""
        listed = flatten(cameras, "cameras")
        return call.render_worlds(self, listed, worlds, mask, options)

    def render_sequence(
        self, camera: Named, times: Any, **options: Unpack[call.Options]
    ) -> Iterator[Frame]:
        """Yields one frame per time, seconds; each is rendered when it is taken."""
        if "time" in options:
            raise InvalidArgument("time: render_sequence sets it", field="time")
        revision = options.pop("revision", None) or self.revision
        for t in np.asarray(times, dtype="f8").ravel():
            options["time"], options["revision"] = float(t), revision
            yield self.render(camera, **options)

    def rerender(self, manifest: str, **options: Unpack[call.Options]) -> Any:
        """Renders a frame again from its manifest, at this scene's latest revision: the same bytes
        for the same content, daemon version and CPU features; of worlds a WorldFrame."""
        request = call.request_of_manifest(self, manifest)
        return call.run(self, request, options)[0]

    def render_batch(
        self, jobs: Iterable[batch.Job], *, credits: int = 4, timeout: float | None = None
    ) -> batch.Results:
        """Renders independent hg.Jobs; gives a Result for each, in the order they are done.

        A Result has the job's `.tag`, and `.frames` or `.error`: one job's error does not end the
        others. At most `credits` jobs are under way; the next one is taken from `jobs` when the
        last Result was. Nothing is published; `.close()` cancels the rest. timeout: seconds, of the
        whole batch.
        """
        return batch.Results(self, jobs, credits, timeout)

    def stream(
        self,
        cameras: Any,
        *,
        policy: str = "latest",
        credits: int = 2,
        **options: Unpack[call.Options],
    ) -> live.Live:
        """`with scene.stream(cam, spp=256) as live:` frames of the scene as it changes.

        Rendered again at each new revision of the scene and each live.update(). policy "latest":
        frames are refined (1, 2, 4, ... samples) until something changes, old ones are dropped.
        "lossless": each update gives its final frames, in order, none is dropped. credits: frames
        that may be under way or held by you. options: of render(); timeout ends the stream.
        """
        return live.Live(self, cameras, policy, credits, options)

    def watch(
        self, from_revision: int | None = None, *, bookmark_seconds: float | None = None
    ) -> _watch.Watch:
        """`with scene.watch() as watch:` each transaction of the scene, by any client, as a Change.

        from_revision: the first one, as far back as the daemon keeps them (OutOfRange has the
        oldest in `.expected`); default: those after this call. bookmark_seconds, [0.5, 3600]: after
        so long without a change comes a bookmark; default: none is shown.
        """
        return _watch.Watch(self, from_revision, bookmark_seconds)

    # ------------------------------------------------------------ reading

    def _info(self) -> service.SceneInfo:
        return self.describe().scene

    def describe(self, **fields: Any) -> service.DescribeSceneReply:
        """DescribeScene as it is: counts, objects (tree=True, pattern=), memory, categories; all
        pages in one."""
        request = service.DescribeSceneRequest(scene=self.id, **fields)
        reply: service.DescribeSceneReply = self.client.whole("DescribeScene", request)
        return reply

    @property
    def revision(self) -> int:
        """The latest revision."""
        return self._info().revision

    @property
    def lifetime(self) -> Lifetime:
        """Lifetime of the scene: "session", "daemon", "disk" or "disk_synced"."""
        return NAMES[self._info().lifetime]

    @property
    def time(self) -> float:
        """The scene's time, seconds."""
        return self._info().time

    @property
    def categories(self) -> dict[int, str]:
        """Class id to name."""
        return {c.id: c.name for c in self.describe().categories}

    def __getitem__(self, name: str) -> Any:
        """The handle of the object with that name; NotFound lists the nearest."""
        return self.handle(self.resolve(name), name)

    def __contains__(self, name: str) -> bool:
        return any(o.name == name for o in self._objects(_escaped(name)))

    def resolve(self, name: str, kind: str = "object") -> int:
        """The id of a name. kind: "entity", "mesh", "material", "texture", "volume", or the first
        of these that has it."""
        named = [each.id for each in self._objects(_escaped(name)) if each.name == name]
        fitting = [id for id in named if kind in ("object", KINDS.get(id >> 56, Handle).kind)]
        if fitting:
            return min(fitting)
        near = difflib.get_close_matches(name, [each.name for each in self._objects("")], 5)
        hint = f"; the nearest are {', '.join(near)}" if near else "; scene.find() lists all"
        raise NotFound(f"name: no object called {name!r}{hint}", field="name", nearest=near)

    def _objects(self, pattern: str) -> Sequence[service.ObjectInfo]:
        return self.describe(tree=True, pattern=pattern).objects

    def handle(self, id: int | str, name: str = "") -> Any:
        """The handle of an id, of the class of its kind; or of a name."""
        if isinstance(id, str):
            return self[id]
        return KINDS.get(id >> 56, Handle)(self, name, id)

    def find(self, pattern: str = "*") -> list[Any]:
        """Handles of the objects whose names match a glob, in id order."""
        return [self.handle(o.id, o.name) for o in self._objects(pattern)]

    def tree(self) -> str:
        """Text of the scene's objects, entities indented under their parents, with their uses."""
        from ..image.notebook import Tree

        return Tree(self._objects("")).text()

    def memory(self) -> dict[str, int]:
        """Bytes: "rows", "arrays" (shared ones counted once), "derived"."""
        return {f.name: v for f, v in self.describe(memory=True).memory.ListFields()}

    def transforms(self, entities: Any) -> NdArray:
        """(N, 4, 4) float32 poses relative to the parents."""
        listed = flatten(entities, "entities")
        if not listed:
            return np.zeros((0, 4, 4), dtype="<f4")
        return np.stack([row[0] for row in self.read(listed, ["pose"])])

    def read(self, things: Sequence[Named], fields: Sequence[str]) -> list[list[Any]]:
        """Reads, per thing, each field: an array, an Edit message, or None where there is none."""
        refs = [t.ref() if isinstance(t, Handle) else types.Ref(name=t) for t in things]
        request = service.ReadRequest(scene=self.id, refs=refs, fields=fields)
        out: list[list[Any]] = [[None] * len(fields) for _ in refs]
        for part in self.client.connection.stream("Read", request):
            row = out[part.ref]
            if part.HasField("object"):
                row[part.field] = part.object
            elif part.HasField("array"):
                row[part.field] = filled(row[part.field], part)
        for row in out:
            for value in row:
                if isinstance(value, np.ndarray):
                    value.setflags(write=False)
        return out

    # ------------------------------------------------------------ queries

    def cast_rays(
        self, origins: Any, directions: Any, *, t_max: float = 0.0, any_hit: bool = False
    ) -> Columns:
        """The first hit of each ray. origins, directions: (N, 3) world; a single one broadcasts.

        Columns: t (N,) metres along the unit direction (+inf: none); entity, its id; instance, its
        label; primitive; barycentric, uv (N, 2); position, normal (N, 3) world. any_hit: only t,
        0 where something is hit.
        """
        return query.cast_rays(self, origins, directions, (t_max, any_hit))

    def pick(self, camera: Named, pixels: Any) -> Columns:
        """Columns of cast_rays() for the surfaces seen at image points (N, 2), K coordinates
        (integers are pixel centres)."""
        return query.pick(self, camera, pixels)

    def visible(self, camera: Named, entities: Any) -> Columns:
        """visible (E,) bool, share (E,) of each entity's silhouette that is seen."""
        return query.visible(self, camera, entities)

    def overlaps(self, a: Any, b: Any) -> NdArray:
        """(A, B) bool: do the surfaces intersect, or does one contain the other."""
        return query.overlaps(self, a, b)

    def sample_surface(self, entities: Any, count: int, *, seed: int = 0) -> Columns:
        """Points uniform over the world area of all: position, normal (N, 3) world, uv,
        barycentric (N, 2), entity, primitive (N,)."""
        return query.sample_surface(self, entities, count, seed)

    def tracks(
        self, camera: Named, points: Any, times: Any, *, through_transmission: bool = False
    ) -> Columns:
        """Projects N points of surfaces at T times (seconds, any order) into a camera.

        points: columns entity, primitive, barycentric, as pick(), cast_rays() and sample_surface()
        give them; or (entity, vertices (N,)); or (entity, primitive (N,), barycentric (N, 2)).
        Columns: image (N, T, 2) K coordinates, nan where the camera does not see that way;
        depth (N, T) metres along the optical axis; position (N, T, 3) world; visible (N, T) bool:
        inside the image, between the clipping planes, and nothing before it. Poses are those at
        that time: shutters play no part.
        """
        return query.tracks(self, camera, points, times, through_transmission)

    # ------------------------------------------------------------ life

    def branch(
        self,
        name: str = "",
        *,
        revision: int | None = None,
        lifetime: Lifetime = "session",
    ) -> Scene:
        """A copy-on-write branch; handles of this scene serve it too, by their ids. lifetime: its
        own, see Client.create_scene."""
        request = service.BranchSceneRequest(
            request_id=uuid.uuid4().hex,
            scene=self.id,
            name=name,
            lifetime=lifetime_of(lifetime),
            revision=revision,
        )
        info = self.client.connection.call("BranchScene", request)
        return self.client.scene_of(info, owned=lifetime == "session")

    def save(self, path: str | os.PathLike[str], *, revision: int | None = None) -> None:
        """Writes the whole scene, arrays and textures included, to one file."""
        from ..scene import scene_file

        request = service.ExportSceneRequest(scene=self.id, revision=revision)
        scene_file.write(path, self.client.connection.stream("ExportScene", request))

    def export(self, path: str | os.PathLike[str], *, revision: int | None = None) -> None:
        """Writes the scene for other programs, by the path's ending: .glb (glTF 2.0) or .usdz.

        Units are metres. Features that the format lacks are left out with a FileWarning that names
        them: docs/formats.md, "Writing". A .usdz needs the extra `usd`; NotFound, InvalidArgument:
        path.
        """
        from ..export.write import export

        export(self, path, revision)

    def delete(self) -> None:
        """Deletes the scene in the daemon."""
        self._owned = False
        request = service.DeleteSceneRequest(request_id=uuid.uuid4().hex, scene=self.id)
        self.client.connection.call("DeleteScene", request)
        self.client.forget(self.id)

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if not self._owned or self.client.connection.closed:
            return
        try:
            self.delete()
        except HeliographError:
            if kind is None:  # an error already on its way explains more
                raise

    def _repr_html_(self) -> str:
        from ..image.notebook import html_of_scene

        return html_of_scene(self)

    def __repr__(self) -> str:
        return f"<Scene {self.name!r} of {self.client.address}>"

    def __reduce__(self) -> Any:
        return Scene, (self.client, self.id, self.name)


def _escaped(name: str) -> str:
    """A glob that matches `name` alone."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)
