"""What is said of the cameras at each window, in the order of windows."""

from __future__ import annotations

from dataclasses import replace

from pipeline.frame import Frame, Window
from pipeline.health.observer import MOST_WAITING, Observer
from pipeline.notes import Note
from tests.frames import PERIOD_NS, RIG, frame, texture, window

LEFT = [frame("left", n * PERIOD_NS, n, image=texture(n)) for n in range(40)]
RIGHT = [frame("right", n * PERIOD_NS, n, image=texture(100 + n)) for n in range(40)]


def at(index: int, left: Frame | None, right: Frame | None) -> Window:
    return window(index, left=left, right=right)


def test_the_notes_of_a_frame_are_told_at_its_window():
    observer = Observer(RIG.cameras)
    seen = []
    for index, (left, right) in enumerate(zip(LEFT[:20], [*RIGHT[:10], *RIGHT[11:21]], strict=True)):
        observer.push(left)
        observer.push(right)
        seen.append(observer.see(at(index, left, right)))
    assert [n for n, one in enumerate(seen) if Note.DROP in one.notes("right")] == [10]
    assert not any(one.notes("left") for one in seen)
    assert observer.report()["right"].drops == 1


def test_what_pairing_left_out_is_told_with_the_frame_that_follows():
    observer = Observer(RIG.cameras)
    for item in (LEFT[0], RIGHT[0], LEFT[1], RIGHT[1], replace(RIGHT[1]), LEFT[2], RIGHT[2]):
        observer.push(item)
    seen = [observer.see(at(n, LEFT[n], RIGHT[n])) for n in range(3)]
    assert [Note.DUPLICATE_FRAME in one.notes("right") for one in seen] == [False, False, True]
    assert observer.report()["right"].duplicates == 1


def silent_right(ended_from: int | None) -> list[int]:
    """The windows at which the right camera, whose last frame is the tenth, is missing."""
    observer = Observer(RIG.cameras)
    missing = []
    for n, left in enumerate(LEFT):
        right = RIGHT[n] if n < 10 else None
        for item in filter(None, (left, right)):
            observer.push(item)
        over = ended_from is not None and n >= ended_from
        seen = observer.see(at(n, left, right), {"right"} if over else ())
        if seen.has("right", Note.MISSING):
            missing.append(n)
    return missing


def test_a_camera_is_missing_after_three_periods_and_half_a_second():
    first = silent_right(None)[0]
    assert 3 * PERIOD_NS + 500_000_000 < (first - 9) * PERIOD_NS <= 5 * PERIOD_NS + 500_000_000


def test_a_recording_that_has_ended_is_not_a_camera_that_has_died():
    assert silent_right(10) == []
    assert silent_right(25) == silent_right(None)


def test_frames_that_never_get_into_a_window_are_not_kept_for_ever():
    observer = Observer(RIG.cameras)
    for n in range(MOST_WAITING + 50):
        observer.push(frame("left", n * PERIOD_NS, n))
    assert observer.report()["left"].frames == 50


def test_a_live_camera_whose_frames_are_held_for_another_one_is_not_missing():
    observer = Observer(RIG.cameras)
    observer.push(LEFT[0])
    observer.push(RIGHT[0])
    observer.see(at(0, LEFT[0], RIGHT[0]))
    for n in range(1, 12):
        observer.push(LEFT[n])
    assert observer.tick(12 * PERIOD_NS) == {"left": (), "right": (Note.MISSING,)}
    observer.push(RIGHT[12])
    assert observer.tick(13 * PERIOD_NS) == {"left": (), "right": ()}


def test_a_live_camera_is_found_missing_by_the_host_clock():
    observer = Observer(RIG.cameras)
    for n in range(5):
        observer.push(LEFT[n])
        observer.push(RIGHT[n])
        observer.see(at(n, LEFT[n], RIGHT[n]))
    assert observer.tick(5 * PERIOD_NS) == {"left": (), "right": ()}
    assert observer.tick(14 * PERIOD_NS) == {"left": (Note.MISSING,), "right": (Note.MISSING,)}
