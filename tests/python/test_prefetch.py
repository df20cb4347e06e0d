"""Dealing of indices to workers, and work ahead of its consumer."""

import itertools
import threading
import time

import heliograph as hg
import pytest
from heliograph.datasets._deal import dealt
from heliograph.datasets._prefetch import in_order


@pytest.mark.parametrize("deal", [(10, 3, 1), (10, 3, 4), (7, 8, 2), (0, 2, 1)])
def test_each_index_is_dealt_once(deal):
    count, parts, block = deal
    hands = [list(dealt(count, part, parts, block=block, start=5)) for part in range(parts)]
    assert sorted(itertools.chain(*hands)) == list(range(5, 5 + count))
    assert all(hand == sorted(hand) for hand in hands)


def test_blocks_stay_together():
    assert list(dealt(10, 1, 2, block=3)) == [3, 4, 5, 9]


def test_without_a_count_there_is_no_end():
    assert list(itertools.islice(dealt(None, 1, 3, block=2), 5)) == [2, 3, 8, 9, 14]


@pytest.mark.parametrize(("arguments", "field"), [((4, 3, 3), "part"), ((-1, 0, 1), "count")])
def test_what_is_not_dealt(arguments, field):
    with pytest.raises(hg.InvalidArgument) as error:
        list(dealt(*arguments))
    assert error.value.field == field


def test_results_come_in_order_whatever_takes_longest():
    def work(item):
        time.sleep(0.02 * (4 - item % 5))
        return item * item

    assert list(in_order(range(12), int, work, 4)) == [i * i for i in range(12)]


@pytest.mark.parametrize("ahead", [0, 1, 3])
def test_so_many_are_begun_ahead(ahead):
    begun = []
    results = in_order(range(20), lambda i: begun.append(i) or i, int, ahead)
    for taken in range(5):
        assert next(results) == taken
        deadline = time.monotonic() + 5
        while len(begun) < taken + 1 + ahead and time.monotonic() < deadline:
            time.sleep(0.001)
        time.sleep(0.01)
        assert begun == list(range(taken + 1 + ahead))
    results.close()


def test_one_thread_prepares():
    names = set()
    list(in_order(range(9), lambda i: names.add(threading.current_thread().name), id, 3))
    assert len(names) == 1


@pytest.mark.parametrize("guilty", ["prepare", "work"])
def test_an_error_comes_in_its_place_and_ends_the_rest(guilty):
    def fail(item):
        if item == 3:
            raise KeyError(item)
        return item

    steps = {"prepare": int, "work": int, guilty: fail}
    seen = []
    with pytest.raises(KeyError):
        for result in in_order(range(100), steps["prepare"], steps["work"], 2):
            seen.append(result)
    assert seen == [0, 1, 2]


def test_closing_waits_for_what_is_under_way_and_begins_nothing_more():
    under_way = threading.Semaphore(0)
    begun, ended = [], []

    def work(item):
        begun.append(item)
        under_way.release()
        time.sleep(0.05)
        ended.append(item)
        return item

    results = in_order(range(100), int, work, 2)
    assert next(results) == 0
    under_way.acquire()
    results.close()
    assert sorted(begun) == sorted(ended) and len(begun) <= 3
    assert not [t for t in threading.enumerate() if t.name.startswith("heliograph-work")]
