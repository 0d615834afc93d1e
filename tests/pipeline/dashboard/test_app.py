"""The dashboard's server, as a browser talks to it."""

from __future__ import annotations

import re
import socket
import time
from contextlib import contextmanager

import pytest

from pipeline.dashboard import app, views
from pipeline.dashboard.serve import bind
from pipeline.dashboard.stream import FRESH_NS, Board
from pipeline.errors import InputError
from tests.network import wait_for
from tests.pipeline.dashboard.served import next_of, served
from tests.pipeline.fleet.said import event, status, verdict
from tests.programs import ROOT

TOKEN = "correct horse battery"  # noqa: S105
WEB = ROOT / "pipeline/dashboard/web"


@pytest.fixture(scope="module")
def site():
    with served() as made:
        yield made


@pytest.fixture(scope="module")
def guarded():
    with served(TOKEN) as made:
        yield made


@pytest.mark.parametrize("path", ["/", "/rig?name=cart", "/style.css", "/main.js", "/icon.svg"])
def test_every_answer_forbids_what_is_not_our_own(site, path):
    answer = site.get(path)
    assert answer.status == 200
    policy = answer.getheader("content-security-policy")
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
    assert "unsafe" not in policy
    assert answer.getheader("x-content-type-options") == "nosniff"


@pytest.mark.parametrize(
    "path", ["/no", "/token.html", "/index.html", "/../app.py", "/%2e%2e/app.py", "/preview?rig=a"]
)
def test_there_is_nothing_else(site, path):
    assert site.get(path).status == 404


def test_the_page_loads_nothing_from_elsewhere_and_has_no_markup_made_of_texts():
    for file in WEB.iterdir():
        text = file.read_text(encoding="utf-8")
        assert set(re.findall(r"https?://[^\s\"']+", text)) <= {"http://www.w3.org/2000/svg"}, file.name
        assert not re.search(r"innerHTML|outerHTML|insertAdjacent|document\.write|\son[a-z]+=|eval\(", text), file.name


def test_a_stream_begins_with_everything_and_goes_on_with_what_changes(site):
    site.fleet.hear_status("changing", status())
    with site.stream() as events:
        (rig,) = [rig for rig in next_of(events, "fleet")["rigs"] if rig["name"] == "changing"]
        assert (rig["tone"], rig["word"]) == ("good", "In sync")
        assert next(events)[0] == "tick"
        site.fleet.hear_status("changing", status("error", reasons=["left-right: right is late"]))
        assert next_of(events, "fleet")["rigs"][0]["detail"] == "left-right: right is late"


def test_of_many_rigs_those_in_trouble_are_told_at_length_and_the_others_in_a_word():
    with served() as made:
        for number in range(views.MANY):
            made.fleet.hear_status(f"rig{number}", status())
        with made.stream() as events:
            assert not any(rig["small"] for rig in next_of(events, "fleet")["rigs"])
            made.fleet.hear_status("late", status("error", reasons=["right is late"]))
            worst, *others = next_of(events, "fleet")["rigs"]
    assert (worst["name"], worst["small"], worst["pairs"][0]["name"]) == ("late", False, "left-right")
    assert [(rig["word"], rig["small"], "trail" in rig) for rig in others] == [("In sync", True, False)] * views.MANY


def test_what_all_pages_are_told_is_written_down_once_a_tick():
    now_ns = 0
    with served() as made:
        board = Board(made.listener, lambda: now_ns)
        first = board.fleet()
        made.fleet.hear_status("cart", status())
        assert board.fleet() is first
        now_ns = FRESH_NS
        assert "cart" in board.fleet()


def test_a_rig_is_told_with_its_pairs_cameras_events_and_offsets(site):
    site.fleet.hear_status("whole", status())
    site.fleet.hear_event("whole", event(1))
    site.fleet.hear_verdict("whole", "left-right", verdict(2.5))
    with site.stream("/stream?rig=whole") as events:
        rig = next_of(events, "rig")
        assert rig["status"]["pairs"]["left-right"]["offset_ms"] == 0.1
        assert rig["status"]["cameras"]["left"]["expected_fps"] == 30
        assert [(e["text"], e["open"]) for e in rig["events"]] == [("onset 1", True)]
        row = next_of(events, "offsets")["pairs"]["left-right"][-1]
        assert row[1:3] == ["s", 2.5]
        site.fleet.hear_verdict("whole", "left-right", verdict(7.5))
        assert next_of(events, "offsets")["pairs"]["left-right"][-1][2] == 7.5


def test_a_rig_that_was_never_heard_is_said_to_be_so_until_it_is(site):
    with site.stream("/stream?rig=late") as events:
        assert next_of(events, "rig")["unheard_of"]
        site.fleet.hear_status("late", status())
        assert next_of(events, "rig")["word"] == "In sync"


def test_previews_are_served_as_pictures_and_nothing_else(site):
    site.fleet.hear_preview("seen/by", "left", b"\xff\xd8\xff<script>")
    answer = site.get("/preview?rig=seen%2Fby&camera=left")
    assert (answer.status, answer.getheader("content-type")) == (200, "image/jpeg")
    assert site.get("/preview?rig=seen%2Fby&camera=right").status == 404


@contextmanager
def stuck_reader(site, path):
    """Asks for a stream and reads nothing of it."""
    with socket.socket() as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        stuck.connect(("127.0.0.1", site.port))
        stuck.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        yield


def test_a_reader_that_takes_nothing_does_not_hold_up_others_and_is_given_up(monkeypatch):
    monkeypatch.setattr(app, "READER_S", 0.5)
    monkeypatch.setattr(app, "MAX_STREAMS", 2)
    with served() as site:
        site.fleet.hear_status("busy", status(reasons=["x" * 100_000]))
        with stuck_reader(site, "/stream?rig=busy"), site.stream("/stream?rig=busy") as events:
            for number in range(6):
                site.fleet.hear_status("busy", status("warn", reasons=[str(number) * 200_000]))
                began = time.monotonic()
                next_of(events, "tick")
                assert time.monotonic() - began < 3
            wait_for(lambda: site.get("/stream").status == 200)


def test_only_so_many_pages_are_kept_up_to_date_at_a_time(monkeypatch):
    monkeypatch.setattr(app, "MAX_STREAMS", 2)
    with served() as site, site.stream() as first:
        next(first)
        with site.stream() as second:
            next(second)
            assert site.get("/stream").status == 503
        wait_for(lambda: site.get("/stream").status == 200)


def test_stopping_is_prompt_with_streams_open_and_with_readers_that_are_stuck():
    with served() as site, stuck_reader(site, "/stream?rig=busy"), site.stream("/stream?rig=busy") as events:
        for number in range(4):
            site.fleet.hear_status("busy", status("warn", reasons=[str(number) * 200_000]))
            next_of(events, "tick")
        site.stop()
        assert site.ended_within_s < 3


@pytest.mark.parametrize("path", ["/", "/stream", "/main.js", "/preview?rig=a&camera=b", "/?token=wrong", "/?token=ö"])
def test_without_the_token_nothing_is_told(guarded, path):
    answer = guarded.get(path.replace("ö", "%C3%B6"))
    assert answer.status == 401
    assert "token" in answer.text


def test_the_token_comes_once_and_then_a_cookie_that_does_not_tell_it(guarded):
    answer = guarded.get(f"/rig?name=cart%2F1&token={TOKEN.replace(' ', '+')}")
    assert (answer.status, answer.getheader("location")) == (303, "/rig?name=cart%2F1")
    cookie = answer.getheader("set-cookie")
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert TOKEN not in cookie
    assert guarded.get("/", cookie=cookie.partition(";")[0]).status == 200
    assert guarded.get("/", cookie=cookie.partition(";")[0] + "0").status == 401


def test_the_way_back_after_the_token_leads_nowhere_else(guarded):
    answer = guarded.get(f"//elsewhere.example/?token={TOKEN.replace(' ', '+')}")
    assert answer.getheader("location") == "/"


def test_a_program_may_send_the_token_as_a_header(guarded):
    assert guarded.get("/", authorization=f"Bearer {TOKEN}").status == 200
    assert guarded.get("/", authorization="Bearer no").status == 401


@pytest.mark.parametrize(
    ("host", "answer"),
    [("localhost:8080", 200), ("[::1]:8080", 200), ("127.0.0.1", 200), ("evil.example:8080", 403), ("", 403)],
)
def test_without_a_token_only_names_of_this_machine_are_answered(site, host, answer):
    assert site.get("/", host=host).status == answer


def test_with_a_token_every_name_is_answered(guarded):
    assert guarded.get("/", host="dashboard.example", authorization=f"Bearer {TOKEN}").status == 200


def test_a_port_in_use_is_said(site):
    with pytest.raises(InputError, match=rf"cannot listen on 127.0.0.1 port {site.port}: Address already in use"):
        bind("127.0.0.1", site.port)


@pytest.mark.parametrize("host", ["no.such.host.invalid", "300.1.2.3", "a" * 300, "192.0.2.1"])
def test_a_host_that_is_none_of_ours_is_said(host):
    with pytest.raises(InputError, match=r"--host"):
        bind(host, 0)
