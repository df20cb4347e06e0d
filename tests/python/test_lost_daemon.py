"""Commands whose daemon is lost while they work, as one that is restarted."""

import argparse
import contextlib

import heliograph as hg
import pytest
from heliograph.cli import _daemon

LOST = (hg.Unavailable("gone"), hg.Unauthenticated("no such session"))


class Daemons:
    """Counts connections. absent: how often nobody listens after a loss."""

    def __init__(self, monkeypatch, absent=0):
        self.connections, self.closed, self.absent = 0, 0, absent
        monkeypatch.setattr(_daemon, "connect", self.connect)

    @contextlib.contextmanager
    def client(self):
        try:
            yield self
        finally:
            self.closed += 1

    def connect(self, arguments):
        if self.connections and self.absent:
            self.absent -= 1
            raise hg.Unavailable("nobody listens")
        self.connections += 1
        return self.client()


def work_that_loses(times, error):
    """Work that is done at the end of so many losses."""
    losses = iter([error] * times)

    def work(client):
        for loss in losses:
            raise loss
        return "done"

    return work


def run(work, address="unix:///run/heliograph.sock"):
    return _daemon.with_client(argparse.Namespace(address=address), work)


@pytest.mark.parametrize("error", LOST, ids=lambda error: type(error).__name__)
def test_a_lost_daemon_is_asked_again(monkeypatch, error):
    daemons = Daemons(monkeypatch, absent=3)
    assert run(work_that_loses(2, error)) == "done"
    assert (daemons.connections, daemons.closed, daemons.absent) == (3, 3, 0)


def test_one_that_is_lost_each_time_is_given_up(monkeypatch):
    daemons = Daemons(monkeypatch)
    with pytest.raises(hg.Unavailable):
        run(work_that_loses(9, LOST[0]))
    assert daemons.connections == daemons.closed == 3


def test_a_private_daemon_that_died_is_not(monkeypatch):
    daemons = Daemons(monkeypatch)
    with pytest.raises(hg.Unavailable):
        run(work_that_loses(1, LOST[0]), address=None)
    assert daemons.connections == 1


def test_other_errors_are_final(monkeypatch):
    daemons = Daemons(monkeypatch)
    with pytest.raises(hg.NotFound):
        run(work_that_loses(1, hg.NotFound("no scene")))
    assert daemons.connections == daemons.closed == 1


def test_where_nobody_listened_from_the_beginning_nobody_waits(monkeypatch):
    def refuse(arguments):
        raise hg.Unavailable("nobody listens")

    monkeypatch.setattr(_daemon, "connect", refuse)
    with pytest.raises(hg.Unavailable):
        run(work_that_loses(0, LOST[0]))
