"""What every kind of fault promises, alone and in pairs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.assemble import KINDS
from pipeline.cli.recording import recording_plan
from pipeline.errors import InputError
from tests.pipeline.faults.streams import Rendered, Scripted, delivered, faulted

LENGTH = 20

EXAMPLES: dict[str, dict[str, Any]] = {
    "slip": {"frames": 1},
    "content_shift": {"frames": -1},
    "seq_offset": {"ids": 3},
    "drop": {"probability": 0.3},
    "frozen": {},
    "stamp_drift": {"ppm": 500},
    "stamp_offset": {"ms": 4},
    "stamp_jitter": {"bias_ms": 5, "sigma_ms": 3},
    "stamp_repeat": {"every": 4},
    "copy_stamp": {"of": "left"},
    "free_run": {"ppm": -60_000},
    "frame_repeat": {"every": 4},
    "seq_wrap": {"bits": 4, "after": 5},
    "swap": {},
    "truncate": {"frames": 3},
    "knock": {"roll_deg": 4},
    "dark": {},
    "exposure": {"period_s": 1.1},
    "dead": {},
}
FAULTS = {kind: {"type": kind, **settings} for kind, settings in EXAMPLES.items()}
FRACTIONS = {kind: {"type": kind, "frames": 0.5} for kind in ("slip", "content_shift")}

WITNESSES = {
    "slip": {"stamp", "moment"},
    "content_shift": {"moment"},
    "seq_offset": {"id"},
    "drop": {"missing"},
    "frozen": {"moment"},
    "stamp_drift": {"stamp"},
    "stamp_offset": {"stamp"},
    "stamp_jitter": {"stamp"},
    "stamp_repeat": {"stamp"},
    "copy_stamp": {"stamp"},
    "free_run": {"stamp", "id", "moment"},
    "frame_repeat": {"again"},
    "seq_wrap": {"id"},
    "swap": {"picture"},
    "truncate": {"missing"},
    "knock": {"picture"},
    "dark": {"picture"},
    "exposure": {"picture"},
    "dead": {"missing"},
}
"""What each kind bends; everything else it leaves as it was."""

RANDOM = ("drop", "stamp_jitter", "dark")
EMPTY = {"drop", "truncate", "dead", "slip", "content_shift", "free_run"}
"""Kinds that leave slots empty, some of them only at the ends."""

SOURCES = {"recorded": Scripted, "rendered": Rendered}

every_kind = pytest.mark.parametrize("kind", FAULTS)
either_source = pytest.mark.parametrize("source", SOURCES.values(), ids=SOURCES)


class Scene(Scripted):
    """Real pictures, which the two cameras see differently, and stamps 1 ms apart."""

    def frames(self):
        for item in super().frames():
            right = item.camera == "right"
            chance = np.random.default_rng([item.sequence, right])
            image = chance.integers(0, 256, (24, 32), np.uint8)
            yield replace(item, image=image, captured_ns=item.captured_ns + 1_000_000 * right)


def scene(*faults, **options):
    return delivered(*faults, source=Scene(count=LENGTH), **options)


def facts(frames):
    """Everything about the frames, comparable."""
    return [
        (f.camera, f.group, f.sequence, f.captured_ns, f.arrived_ns, f.clock, f.truth, f.image.tobytes())
        for f in frames
    ]


def bent(kind):
    """Which of its own properties the right camera's frames show changed."""
    before = {item.group: item for item in scene(camera="right")}
    after = scene(FAULTS[kind], camera="right")
    changed = set() if len({item.group for item in after}) == len(before) else {"missing"}
    if len({item.group for item in after}) < len(after):
        changed.add("again")
    for item in after:
        clean = before[item.group]
        changed |= {"stamp"} if item.captured_ns != clean.captured_ns else set()
        changed |= {"id"} if item.sequence != clean.sequence else set()
        moved = item.truth.shown_ns != clean.truth.shown_ns
        changed |= {"moment"} if moved else set()
        changed |= {"picture"} if not moved and not np.array_equal(item.image, clean.image) else set()
    return changed


def test_every_kind_has_its_examples_here():
    assert set(EXAMPLES) == set(WITNESSES) == set(KINDS.tables["faults"])


@every_kind
def test_it_bends_what_it_says_and_nothing_else(kind):
    ends = {"missing"} if kind in EMPTY else set()
    assert WITNESSES[kind] <= bent(kind) <= WITNESSES[kind] | ends


@every_kind
def test_the_other_camera_is_left_alone(kind):
    alone = facts(scene(FAULTS[kind], camera="left")) == facts(scene(camera="left"))
    assert alone == (kind != "swap"), "which takes two"


@every_kind
def test_it_is_active_from_its_start_to_its_stop_only(kind):
    window = {"start_s": 0.5, "stop_s": 1.2}
    clean = facts(scene())
    assert [f for f in facts(scene({**FAULTS[kind], **window})) if not 105 <= f[1] < 112] == [
        f for f in clean if not 105 <= f[1] < 112
    ]
    assert facts(scene({**FAULTS[kind], "start_s": 1.0})) != clean, "but it is active at all"


@every_kind
def test_frames_keep_the_slot_in_which_they_were_delivered(kind):
    for source in SOURCES.values():
        frames = delivered(FAULTS[kind], source=source(count=LENGTH))
        for camera in ("left", "right"):
            groups = [item.group for item in frames if item.camera == camera]
            assert groups == sorted(groups)
            assert set(groups) <= set(range(100, 100 + LENGTH))
            assert kind == "frame_repeat" or len(set(groups)) == len(groups)
            assert all(item.arrived_ns == (item.group - 100) * 100_000_000 for item in frames)


@every_kind
def test_the_same_seed_gives_the_same_frames(kind):
    assert facts(scene(FAULTS[kind], seed=7)) == facts(scene(FAULTS[kind], seed=7))
    assert (facts(scene(FAULTS[kind], seed=7)) != facts(scene(FAULTS[kind], seed=8))) == (kind in RANDOM)


@every_kind
def test_it_does_not_matter_in_which_order_the_cameras_are_read(kind):
    class RightFirst(Scene):
        def frames(self):
            yield from sorted(super().frames(), key=lambda item: item.sequence + 3 * (item.camera == "left"))

    in_turn = facts(delivered(FAULTS[kind], source=Scene(count=LENGTH)))
    assert facts(delivered(FAULTS[kind], source=RightFirst(count=LENGTH))) == in_turn


@pytest.mark.parametrize("kind", RANDOM)
def test_cameras_draw_numbers_of_their_own(kind):
    def drawn(*cameras):
        frames = delivered(*({**FAULTS[kind], "camera": camera} for camera in cameras), source=Scripted(count=LENGTH))
        return {
            camera: {f.group: (f.captured_ns, f.image.tobytes()) for f in frames if f.camera == camera}
            for camera in ("left", "right")
        }

    both = drawn("left", "right")
    assert both["left"] != both["right"]
    assert both["right"] == drawn("right")["right"], "whatever happens to the left camera"


@every_kind
@either_source
def test_the_truth_is_right_however_two_of_them_are_combined(kind, source):
    """The picture of these streams tells which moment it shows, unless it is too dark."""
    first = [FAULTS[kind], *([FRACTIONS[kind]] if kind in FRACTIONS and source is Rendered else [])]
    others = [*FAULTS.values(), *(FRACTIONS.values() if source is Rendered else ())]
    for one in first:
        for other in others:
            frames = delivered(one, other, source=source(count=LENGTH))
            kinds = {one["type"], other["type"]}
            assert kinds & {"dead", "drop", "truncate"} or len(frames) > LENGTH
            if not kinds & {"dark", "exposure"}:
                for item in frames:
                    told = source(count=LENGTH).shown(item.truth.shown_ns)
                    assert np.array_equal(item.image, told), f"{one} then {other}: {item}"
            if "swap" not in kinds:
                assert all(item.truth.faults == () for item in frames if item.camera == "left")
                acting = kinds - {"truncate"}
                assert all(acting <= set(item.truth.faults) for item in frames if item.camera == "right"), (one, other)


@pytest.mark.parametrize("shift", FRACTIONS.values(), ids=FRACTIONS)
@pytest.mark.parametrize("kind", ["dark", "knock", "swap", "frozen"])
def test_what_happened_to_a_picture_stays_when_it_is_rendered_anew(kind, shift):
    class Slanted(Rendered):
        """A ramp that runs another way for each camera."""

        def frames(self):
            for item in super().frames():
                yield replace(item, image=self.picture_at(item.camera, item.captured_ns))

        def picture_at(self, camera, shown_ns):
            ramp = np.arange(0, 128, 4, dtype=np.uint8)
            turned = ramp if camera == "left" else ramp[::-1]
            return (np.tile(turned, (24, 1)) + self.shown(shown_ns)[0, 0] // 2).astype(np.uint8)

    settings = {"knock": {"roll_deg": 180}}.get(kind, {})
    fault = {"type": kind, **settings}
    only = delivered(fault, source=Slanted(count=LENGTH), camera="right")[5].image.astype(int)
    both = delivered(fault, shift, source=Slanted(count=LENGTH), camera="right")[5].image.astype(int)
    clean = delivered(source=Slanted(count=LENGTH), camera="right")[5].image.astype(int)
    assert np.abs(both - only).max() <= 3, "half a period later it is 2.5 levels brighter"
    assert np.abs(both - clean).max() > 20


def bad_values():
    for kind, example in EXAMPLES.items():
        fields = KINDS.tables["faults"][kind].settings.model_fields
        for name, field in fields.items():
            if any(number in str(field.annotation) for number in ("int", "float")):
                yield from ((kind, {**example, name: value}) for value in (math.nan, math.inf, -math.inf, "much"))
        yield from ((kind, {**example, "start_s": value}) for value in (-1, None))
        yield kind, {**example, "stop_s": 0}
        yield kind, {**example, "frmaes": 1}
        yield kind, {**example, "camera": 5}
    yield from (("drop", {"probability": value}) for value in (-0.1, 0, 1.1))
    yield from ((kind, {"every": value}) for kind in ("drop", "frame_repeat", "stamp_repeat") for value in (-3, 0, 2.5))
    yield from (("stamp_jitter", {"sigma_ms": -1}), ("stamp_repeat", {"every": 1}), ("truncate", {"frames": 0}))
    yield from (("seq_wrap", {"bits": 0}), ("seq_wrap", {"after": 0}), ("slip", {"frames": 301}))
    yield from (("knock", {"pitch_deg": 11}), ("knock", {"focal_px": 0}), ("free_run", {"ppm": -1e6}))


@every_kind
def test_values_that_make_no_sense_are_refused_in_one_line_that_names_them(kind, tmp_path):
    cases = [settings for name, settings in bad_values() if name == kind]
    assert cases
    for settings in cases:
        text = ",".join(f"{key}={_yaml(value)}" for key, value in settings.items())
        with pytest.raises(InputError) as refused:
            recording_plan([str(tmp_path)], faults=[f"{kind}:{text}"])
        assert str(refused.value).count("error: faults[0]") == 1, text


@every_kind
@pytest.mark.parametrize("key", ["camera", "of", "partner"])
def test_a_camera_that_does_not_exist_is_refused_with_those_that_do(kind, key):
    if key not in KINDS.tables["faults"][kind].settings.model_fields:
        key = "camera"
    for name in ("top", ""):
        with pytest.raises(InputError, match=f"^fault {kind}: no camera '{name}': this rig has left, right$"):
            faulted({**FAULTS[kind], key: name}).open()


@pytest.mark.parametrize(("kind", "key"), [("copy_stamp", "of"), ("swap", "partner")])
def test_a_camera_is_not_its_own_partner(kind, key):
    with pytest.raises(InputError, match=f"^fault {kind}: {key}: 'left' is the camera itself"):
        faulted({"type": kind, "camera": "left", key: "left"}).open()
    faulted({"type": kind, "camera": "left"}).open()


def _yaml(value: object) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return {"nan": ".nan", "inf": ".inf", "-inf": "-.inf"}[str(value)]
    return "null" if value is None else str(value)
