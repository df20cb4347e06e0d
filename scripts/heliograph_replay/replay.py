"""Plays a recording against a daemon and compares the answers. Called by the command `replay`.

Calls are played one after another, each where it took effect: an edit where its revision was made,
a frame at the revision that it shows. docs/operations.md describes what is played how.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from heliograph._wire.status import status_error
from heliograph.client.client import Client
from heliograph.errors import HeliographError, InvalidArgument

from ._calls import COMPARED, Calls, Differs, NotPlayed
from ._questions import QUESTIONS, Questions
from .reader import Call, Damaged, Part, Recording

SAME, DIFFERS, NOT_PLAYED = "same", "differs", "not played"
# Codes of calls whose end depended on time or on other calls.
_BY_TIME = ("CANCELLED", "DEADLINE_EXCEEDED", "UNAVAILABLE", "UNAUTHENTICATED")


@dataclass(frozen=True)
class Outcome:
    """Outcome of a call, or of one edit, item or frame of a stream."""

    call: Call
    what: str  # "call 7 Apply", "call 9 RenderBatch, item 3"
    verdict: str
    text: str = ""  # how it differs, or why it was not played


@dataclass
class _Step:
    call: Call
    what: str
    at: int  # place in the order of the recording
    play: Callable[[], None]
    scene: int = 0
    revision: int = 0  # that it makes, or needs
    at_head: bool = False  # it is to be played before the next revision
    is_done: bool = False


def replay(recording: Recording, client: Client, tenant: str | None = None) -> Iterator[Outcome]:
    """Plays a tenant's calls, each session in one of its own; what became of each."""
    tenants = recording.tenants()
    if tenant is None and len(tenants) > 1:
        raise InvalidArgument(f"tenant: say which of {', '.join(tenants)}", field="tenant")
    if tenant is not None and tenant not in tenants:
        names = ", ".join(tenants) or "none"
        raise InvalidArgument(f"tenant: no {tenant!r} is recorded, only {names}", field="tenant")
    calls = Calls(recording, client)
    questions = Questions(recording, calls)
    try:
        yield from _Player(recording, (calls, questions), tenant).play()
    finally:
        questions.close()
        calls.close()


class _Player:
    """The order in which steps are played."""

    def __init__(
        self, recording: Recording, ways: tuple[Calls, Questions], tenant: str | None
    ) -> None:
        self._recording = recording
        self._calls, self._questions = ways
        self._steps: list[_Step] = []
        # Accepted edits by scene, each followed by the questions that came before the next.
        self._in_order: dict[int, deque[_Step]] = defaultdict(deque)
        self._made_at: dict[tuple[int, int], int] = {}  # (scene, revision): place of its edit
        self._plan(
            [
                call
                for call in recording.calls.values()
                if tenant in (None, recording.sessions[call.session].tenant)
            ]
        )

    def _plan(self, calls: list[Call]) -> None:
        for call in calls:
            if call.method in ("Apply", "ApplyStream"):
                self._add_call(call, self._add_edits)
        edits = [step for step in self._steps if step.revision]
        for step in sorted(edits, key=lambda step: (step.revision, step.at)):
            self._made_at.setdefault((step.scene, step.revision), step.at)
        others = {
            **dict.fromkeys(QUESTIONS, self._add_question),
            "Watch": self._add_watch,
            "BranchScene": self._add_branch,
            "Render": self._add_render,
            "RenderBatch": self._add_items,
            "Stream": self._add_frames,
        }
        for call in calls:
            if call.method not in ("Apply", "ApplyStream"):
                self._add_call(call, others.get(call.method, self._add_whole))
        edits += [step for step in self._steps if step.at_head]
        for step in sorted(edits, key=lambda step: (step.revision, step.at_head, step.at)):
            self._in_order[step.scene].append(step)
        self._steps.sort(key=lambda step: step.at)

    def _add_call(self, call: Call, add: Callable[[Call], None]) -> None:
        try:
            add(call)
        except Damaged as damage:
            self._add(call, call.end, partial(_damaged, str(damage)))

    def play(self) -> Iterator[Outcome]:
        """Runs each step, and the ends of sessions between them."""
        ends = deque(self._recording.ends)
        for step in self._steps:
            while ends and ends[0][0] < step.at:
                self._calls.end(ends.popleft()[1])
            yield from self._run(step)

    def _run(self, step: _Step) -> Iterator[Outcome]:
        """The step, after the edits that its revision needs and the questions between them."""
        if step.is_done:
            return
        step.is_done = True
        others = self._in_order[step.scene]
        while others and (others[0].revision, others[0].at_head) <= (step.revision, False):
            yield from self._run(others.popleft())
        yield Outcome(step.call, step.what, *_judge(step))

    # ------------------------------------------------------------ steps

    def _add(
        self,
        call: Call,
        at: int,
        play: Callable[[], None],
        *,
        part: str = "",
        shows: tuple[int, int] = (0, 0),
        at_head: bool = False,
    ) -> None:
        what = f"{call}, {part}" if part else str(call)
        self._steps.append(_Step(call, what, at, play, *shows, at_head))

    def _refusal(self, call: Call) -> HeliographError | None:
        if call.status is None or call.status.item.status.code == 0:
            return None
        return status_error(call.status.item.status)

    def _reason(self, call: Call) -> str:
        """Reason why a call is left out; "": it is not."""
        if call.status is None or not call.requests:
            return "the recording ends before its answer"
        refused = self._refusal(call)
        if refused is not None and refused.code == "ABORTED" and call.method != "Apply":
            return "it met another call"
        return _by_time(refused)

    def _add_whole(self, call: Call) -> None:
        is_known = call.method in COMPARED
        reason = self._reason(call) if is_known else "this client does not know such calls"
        play = partial(_skip, reason) if reason else partial(self._calls.whole, call)
        self._add(call, call.end, play)

    def _add_branch(self, call: Call) -> None:
        if self._reason(call) or not call.replies:
            return self._add_whole(call)
        scene = self._calls.scene_of(call, call.requests[0])
        revision = int(self._recording.reply(call, call.replies[0]).revision)
        shows = (scene, revision)
        play = partial(self._calls.branch, call, revision)
        return self._add(call, self._shown_at(call.at, shows), play, shows=shows)

    def _add_edits(self, call: Call) -> None:
        if call.method == "Apply" and (reason := self._reason(call)):
            return self._add(call, call.end, partial(_skip, reason))
        refused = self._refusal(call) if call.method == "Apply" else None
        for index, part in enumerate(call.requests):
            answer = call.replies[index] if index < len(call.replies) else None
            name = "" if call.method == "Apply" else f"edit {index + 1}"
            if answer is None and refused is None:
                self._add(call, call.end, partial(_skip, "it was not answered"), part=name)
                continue
            was: Any = self._recording.reply(call, answer) if answer else refused
            if answer and was.HasField("status"):
                was = status_error(was.status)
            is_refused = isinstance(was, HeliographError)
            reason = _by_time(was) if is_refused else ""
            self._add(
                call,
                answer.at if answer else call.end,
                partial(_skip, reason) if reason else partial(self._calls.edit, call, part, was),
                part=name,
                shows=(self._calls.scene_of(call, part), 0 if is_refused else int(was.revision)),
            )
        return None

    def _shown_at(self, at: int, shows: tuple[int, int]) -> int:
        """Place at which something that began at `at` saw its revision."""
        return max(at, self._made_at.get(shows, 0))

    def _add_render(self, call: Call) -> None:
        refused, reason = self._refusal(call), self._reason(call)
        frames = [part.item for part in call.frames]
        if not (reason or refused or frames):
            reason = "its frames are not in the recording"
        if reason or refused or not frames:
            play = partial(_skip, reason) if reason else partial(self._calls.render, call, refused)
            return self._add(call, call.end, play)
        shows = self._calls.scene_of(call, call.requests[0]), int(frames[0].revision)
        play = partial(self._calls.render, call, frames)
        return self._add(call, self._shown_at(call.at, shows), play, shows=shows)

    def _add_items(self, call: Call) -> None:
        """Items answer with their tag; equal tags in the order in which they came."""
        done: dict[int, deque[tuple[Part, Any]]] = defaultdict(deque)
        for part in call.replies:
            reply = self._recording.reply(call, part)
            done[reply.tag].append((part, reply))
        since: dict[int, int] = defaultdict(int)
        for index, part in enumerate(call.requests):
            tag, name = self._calls.tag_of(call, part), f"item {index + 1}"
            if tag is None:
                continue  # only credits
            if not done[tag]:
                self._add(call, call.end, partial(_skip, "it was not answered"), part=name)
                continue
            end, reply = done[tag].popleft()
            frames = [
                frame.item
                for frame in call.frames
                if frame.item.tag == tag and since[tag] < frame.at < end.at
            ]
            since[tag] = end.at
            self._add_item(call, part, name, (end.at, reply, frames))

    def _add_item(
        self, call: Call, part: Part, name: str, answer: tuple[int, Any, list[Any]]
    ) -> None:
        end, reply, frames = answer
        if reply.HasField("status"):
            refused = status_error(reply.status)
            reason = _by_time(refused)
            play = partial(self._calls.item, call, part, refused)
            return self._add(call, end, partial(_skip, reason) if reason else play, part=name)
        shows = self._calls.scene_of(call, part), int(frames[0].revision) if frames else 0
        play = partial(self._calls.item, call, part, frames)
        return self._add(call, self._shown_at(part.at, shows), play, part=name, shows=shows)

    def _add_question(self, call: Call) -> None:
        """Adds a question at the revision that it was answered from, the newest one unless it named
        one."""
        if reason := self._reason(call):
            return self._add(call, call.end, partial(_skip, reason))
        assert call.status is not None
        status, play = call.status.item, partial(self._questions.ask, call)
        if not status.HasField("revision"):  # it was refused before
            return self._add(call, call.end, play)
        request = self._recording.request(call, call.requests[0])
        shows = int(request.scene), int(status.revision)
        names_one = "revision" in request.DESCRIPTOR.fields_by_name and request.HasField("revision")
        at = self._shown_at(call.at, shows)
        return self._add(call, at, play, shows=shows, at_head=not names_one)

    def _add_watch(self, call: Call) -> None:
        """Adds a watch: a step where it began, and one where it gave its last transaction."""
        if not call.replies or not call.requests:
            return self._add_question(call)
        scene = self._calls.scene_of(call, call.requests[0])
        replies = [self._recording.reply(call, part) for part in call.replies]
        at_head = self._recording.request(call, call.requests[0]).from_revision == 0
        begins = scene, int(replies[0].revision)
        at = self._shown_at(call.at, begins)
        play = partial(self._questions.begin, call)
        self._add(call, at, play, part="its beginning", shows=begins, at_head=at_head)
        if changes := [each.revision for each in replies if each.HasField("transaction")]:
            shows = scene, int(changes[-1])
            play = partial(self._questions.compare_changes, call)
            part = f"revisions {changes[0]} to {changes[-1]}"
            self._add(call, max(at, call.replies[-1].at), play, part=part, shows=shows)
        return None

    def _add_frames(self, call: Call) -> None:
        """Adds each frame of a Stream alone: which ones are shown depends on time."""
        for index, part in enumerate(call.frames):
            shows = self._calls.scene_of_frame(part.item), int(part.item.revision)
            play = partial(self._calls.again, call, part.item)
            at = self._shown_at(call.at, shows)
            self._add(call, at, play, part=f"frame {index + 1}", shows=shows)


def _judge(step: _Step) -> tuple[str, str]:
    try:
        step.play()
    except NotPlayed as reason:
        return NOT_PLAYED, str(reason)
    except (Differs, Damaged) as difference:
        return DIFFERS, str(difference)
    except HeliographError as error:
        return DIFFERS, f"{error.code}: {error}"
    return SAME, ""


def _by_time(refused: HeliographError | None) -> str:
    """Reason why an answer that depended on time is not compared; "": it did not."""
    if refused is None or not (refused.code in _BY_TIME or refused.retry_seconds > 0):
        return ""
    return f"it depended on time: {refused.code}"


def _skip(reason: str) -> None:
    raise NotPlayed(reason)


def _damaged(what: str) -> None:
    raise Damaged(what)
