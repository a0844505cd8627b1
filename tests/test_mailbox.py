"""The mailbox: lines of JSON from several pipes, in the order of each, however they come in pieces; None at the end."""

import json
import os
import queue
import select
import time

import pytest

from estimator.fmus import mailbox
from estimator.fmus.mailbox import Mailbox


@pytest.fixture(params=["waited for", "by threads"])
def box(request, monkeypatch):
    if request.param == "by threads":
        monkeypatch.delattr(select, "poll")
    return Mailbox()


def sender(box, name):
    read, write = os.pipe()
    box.join(name, os.fdopen(read, "rb"))
    return os.fdopen(write, "wb", buffering=0)


def test_answers_come_in_their_order_and_then_the_end(box):
    first, second = sender(box, "first"), sender(box, "second")
    for k in range(3):
        first.write(json.dumps({"k": k}).encode() + b"\n")
    assert [box.get(timeout=5) for _ in range(3)] == [("first", {"k": k}) for k in range(3)]
    second.write(b'{"k": 7}\n')
    second.close()
    assert [box.get(timeout=5) for _ in range(2)] == [("second", {"k": 7}), ("second", None)]
    first.close()
    assert box.get(timeout=5) == ("first", None)


def test_an_answer_that_comes_in_pieces_is_one(box, monkeypatch):
    monkeypatch.setattr(mailbox, "CHUNK", 8)
    pipe, long = sender(box, "only"), {"text": "abc" * 50}
    whole = json.dumps(long).encode() + b'\n{"k": 1}\n{"k"'
    pipe.write(whole[:11])
    with pytest.raises(queue.Empty):
        box.get(timeout=0.02)
    pipe.write(whole[11:])
    assert [box.get(timeout=5) for _ in range(2)] == [("only", long), ("only", {"k": 1})]
    pipe.write(b": 2}\n")
    assert box.get(timeout=5) == ("only", {"k": 2})
    pipe.close()
    assert box.get(timeout=5) == ("only", None)


@pytest.mark.parametrize("foreign", [b"hello\n", b"\xff\x00\n", b"[1, 2]\n", b"7\n"])
def test_what_is_no_answer_is_the_last_word(box, foreign):
    pipe, other = sender(box, "only"), sender(box, "other")
    pipe.write(b'{"k": 1}\n' + foreign + b'{"k": 2}\n')
    assert [box.get(timeout=5) for _ in range(2)] == [("only", {"k": 1}), ("only", None)]
    other.write(b'{"k": 3}\n')
    assert box.get(timeout=5) == ("other", {"k": 3})
    with pytest.raises(queue.Empty):
        box.get(timeout=0.05)
    other.close()
    assert box.get(timeout=5) == ("other", None)
    pipe.close()


def test_where_nothing_comes_the_time_is_kept(box):
    pipe = sender(box, "only")
    began = time.monotonic()
    with pytest.raises(queue.Empty):
        box.get(timeout=0.1)
    assert 0.09 < time.monotonic() - began < 3
    pipe.close()
    assert box.get(timeout=5) == ("only", None)


def test_what_is_put_back_comes_again(box):
    box.put("one", {"k": 1})
    assert box.get(timeout=0) == ("one", {"k": 1})


@pytest.mark.skipif(not hasattr(select, "poll"), reason="no pipe can be waited for")
def test_one_that_has_left_is_heard_no_more_and_its_pipe_is_closed():
    box = Mailbox()
    read, write = os.pipe()
    pipe = os.fdopen(read, "rb")
    box.join("only", pipe)
    os.write(write, b"{}\n")
    box.leave("only")
    box.leave("only")
    assert pipe.closed
    with pytest.raises(queue.Empty):
        box.get(timeout=0.02)
    os.close(write)
