"""What a newcomer reads first of a run."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.notes import Note
from pipeline.sentences import NOTE_WORDS, said
from pipeline.timeline import Mark, Span, Timeline

PERIOD_MS = 100 / 3


def timeline(*marks: Mark, held: str = "sync") -> Timeline:
    return Timeline("left-right", PERIOD_MS, 10.0, 4.0, said=[Span(0.0, 10.0, held)], marks=list(marks))


def onset(cause: str | None, **told: Any) -> Mark:
    kind = "async onset" if cause else "geometry_shift onset"
    return Mark(4.2, kind, "right was knocked", since_s=4.0, cause=cause, camera="right", **told)


@pytest.mark.parametrize(
    ("mark", "sentence"),
    [
        (
            onset("stamps_lie", offset_ms=-33.3, stamps_ms=0.1),
            "From 4.0 s on right shows pictures that are a frame (33.3 ms) old beside left's, although its stamps say "
            "that nothing is wrong.",
        ),
        (
            onset("stamps_lie", offset_ms=16.8, stamps_ms=33.0),
            "From 4.0 s on right shows pictures that are 16.8 ms newer than left's, although its stamps say otherwise.",
        ),
        (
            onset("slip", offset_ms=66.7),
            "From 4.0 s on right is 2 frames (66.7 ms) ahead of left: frames are paired with the wrong partners.",
        ),
        (
            onset("phase", offset_ms=-16.7),
            "From 4.0 s on right takes its pictures 16.7 ms before left: the cameras are not triggered together.",
        ),
        (
            onset("free_run", offset_ms=-4.0, drift_ppm=-417.0),
            "From 4.0 s on right drifts away from left by 417 ppm, a frame in 80 s: it runs at a rate of its own.",
        ),
        (
            onset("frozen"),
            "From 4.0 s on right shows the same picture again and again while left sees things move.",
        ),
        (onset("missing"), "From 4.0 s on right delivers nothing."),
        (onset(None), "From 4.0 s on: right was knocked."),
    ],
)
def test_an_event_is_told_with_time_camera_and_amount(mark, sentence):
    assert said(timeline(mark)) == sentence


@pytest.mark.parametrize("cause", ["stamps_lie", "slip", "phase", "free_run"])
def test_an_event_without_a_number_is_told_without_one(cause):
    text = said(timeline(onset(cause)))
    assert "ms" not in text.split()
    assert "None" not in text


def test_an_event_that_ends_is_told_with_its_end():
    end = Mark(8.3, "async end", "left-right in sync again", camera="right")
    assert said(timeline(onset("missing"), end)) == "From 4.0 s to 8.3 s right delivers nothing."
    to_the_end = Mark(10.0, "async end", "to the end: right delivers nothing", camera="right")
    assert said(timeline(onset("missing"), to_the_end)) == "From 4.0 s on right delivers nothing."


def test_an_event_that_follows_upon_another_begins_where_that_ends():
    first = Mark(2.0, "async onset", "", since_s=1.8, cause="phase", camera="right", offset_ms=-40.0)
    end = Mark(5.0, "async end", "out of sync in another way", camera="right")
    second = Mark(5.0, "async onset", "", since_s=1.8, cause="phase", camera="right", offset_ms=30.0)
    text = said(timeline(first, end, second))
    assert "From 1.8 s to 5.0 s right takes its pictures 40.0 ms before left" in text
    assert "From 5.0 s on right takes its pictures 30.0 ms after left" in text


def test_many_events_are_counted():
    text = said(timeline(*[onset("missing")] * 7))
    assert text.count("delivers nothing") == 4
    assert text.endswith("3 more events follow.")


@pytest.mark.parametrize(
    ("held", "sentence"),
    [
        ("sync", "Nothing is wrong with this rig."),
        ("unknown no_motion", "Nothing can be said of this rig: nothing moves in a way that tells time."),
        ("async slip", "Nothing lasting is wrong, but for 10.00 s the cameras were called out of sync."),
    ],
)
def test_without_events_the_verdicts_are_told(held, sentence):
    assert said(timeline(held=held)) == sentence


def test_of_a_run_without_a_verdict_nothing_can_be_said():
    assert said(Timeline("left-right", PERIOD_MS, 0.0, 0.0)) == "Nothing can be said of this rig."


def test_every_note_has_its_words():
    assert set(NOTE_WORDS) == set(Note)
    assert said(timeline(Mark(0.0, "note", "drop"))).endswith("Noticed besides: frames were lost.")


def test_what_was_last_seen_long_before_the_end_is_told_with_that():
    heard = timeline(onset("slip", offset_ms=66.7))
    heard.said = [Span(0.0, 4.0, "sync"), Span(4.0, 6.5, "async slip"), Span(6.5, 10.0, "unknown no_motion")]
    assert said(heard).startswith("From 4.0 s on, as last seen at 6.5 s, right is 2 frames (66.7 ms) ahead of left")
