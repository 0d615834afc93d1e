"""`syncwatch repair`, from outside."""

from __future__ import annotations

import hashlib

import pytest
from mcap.reader import make_reader

from pipeline.frame import StampOrigin
from tests.programs import inside, write_folders
from tests.recorded import replayed

CONFIG = """
source: {type: synthetic, duration_s: 4, width: 320, height: 240}
faults: [FAULT]
detectors: {timestamp: {}}
"""


def recorded(folder, fault):
    (folder / "rig.yaml").write_text(CONFIG.replace("FAULT", fault))
    done = inside("record", "rig.yaml", "-o", "in.mcap", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "in.mcap"


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def repaired(tmp_path_factory):
    """A recording that slips by two frames in its middle, and what became of it."""
    folder = tmp_path_factory.mktemp("repaired")
    path = recorded(folder, "{type: slip, camera: right, frames: 2, start_s: 1.5}")
    before = digest(path)
    done = inside("repair", "in.mcap", "out.mcap", cwd=folder)
    assert digest(path) == before
    return folder, done


def off_ns(path):
    """How far apart the moments are that the frames of each whole group show."""
    shown = {}
    for item in replayed(path):
        shown.setdefault(item.group, []).append(item.truth.shown_ns)
    return [abs(moments[1] - moments[0]) for moments in shown.values() if len(moments) == 2]


def test_frames_are_together_that_were_taken_together(repaired):
    folder, done = repaired
    assert done.returncode == 0, done.stderr
    assert sum(off > 10_000_000 for off in off_ns(folder / "in.mcap")) > 70
    assert len(off_ns(folder / "out.mcap")) > 110
    assert sum(off > 10_000_000 for off in off_ns(folder / "out.mcap")) <= 4


def test_what_was_out_of_sync_is_judged_in_sync(repaired):
    folder, _ = repaired
    assert inside("check", "in.mcap", cwd=folder).returncode == 3
    done = inside("check", "out.mcap", cwd=folder)
    assert (done.returncode, "In sync." in done.stdout) == (0, True), done.stdout


def test_it_says_what_was_done_in_words_and_in_the_file(repaired):
    folder, done = repaired
    lines = done.stdout.splitlines()
    assert lines[0].endswith("out.mcap:")
    assert any("left-right: from frame 4" in line and "right moved by +2 frames" in line for line in lines)
    with (folder / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        (attached,) = reader.iter_attachments()
    told = metadata["syncwatch.repair.v1"]
    assert (told["source"], told["restamp"]) == ("in.mcap", "false")
    assert told["shifts_left-right"].endswith(":2")
    assert metadata["syncwatch.recording.v1"]["repaired_from"] == "in.mcap"
    assert (attached.name, attached.media_type) == ("repair.txt", "text/plain")
    assert "right moved by +2 frames" in attached.data.decode()


def test_stamps_and_counters_stay_as_they_were_unless_asked(repaired):
    folder, _ = repaired
    before = {(item.camera, item.sequence): item for item in replayed(folder / "in.mcap")}
    for item in replayed(folder / "out.mcap"):
        original = before[item.camera, item.sequence]
        assert (item.captured_ns, item.stamp_origin) == (original.captured_ns, original.stamp_origin)


def test_stamps_that_lie_are_put_right_on_request(tmp_path):
    recorded(tmp_path, "{type: stamp_offset, camera: right, ms: 12, start_s: 0}")
    done = inside("repair", "in.mcap", "out.mcap", "--restamp", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    frames = replayed(tmp_path / "out.mcap")
    left = {item.group: item for item in frames if item.camera == "left"}
    right = [item for item in frames if item.camera == "right"]
    assert len(right) >= 115
    assert all(abs(item.captured_ns - left[item.group].captured_ns) < 1_000_000 for item in right)
    assert {item.stamp_origin for item in right} == {StampOrigin.SYNTHESISED}
    assert {item.stamp_origin for item in left.values()} == {StampOrigin.DEVICE}


def test_a_folder_is_repaired_as_well_and_what_cannot_be_told_is_said(tmp_path):
    folder = write_folders(tmp_path / "rig", 6)
    done = inside("repair", folder, "out.mcap", "--fps", "10", "--pictures", "png", cwd=tmp_path)
    assert done.returncode == 4, done.stderr
    assert "left-right: no offset could be measured: its frames are paired as they were" in done.stdout
    assert len(replayed(tmp_path / "out.mcap")) == 12


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["in.mcap"], "OUT.mcap"),
        (["nowhere", "out.mcap"], "no such file or folder: nowhere"),
        (["in.mcap", "in.mcap"], "never changed"),
        (["in.mcap", "link.mcap", "--force"], "never changed"),
        (["out.mcap.part", "out.mcap"], "never changed"),
        (["rig", "rig/out.mcap"], "never changed"),
        (["in.mcap", "there.mcap"], "there.mcap: exists already: name another file, or give --force"),
        (["in.mcap", "rig"], "is a folder"),
        (["in.mcap", "nowhere/out.mcap"], "there is no folder"),
        (["there.mcap", "out.mcap"], "no recording that is known"),
        (["in.mcap", "out.mcap", "--set", "align.max_frames=0"], "align.max_frames: must be at least 1"),
        (["in.mcap", "out.mcap", "--pictures", "none"], "--pictures"),
    ],
)
def test_bad_arguments_are_one_clear_line_and_nothing_is_written(repaired, tmp_path, arguments, said):
    folder, _ = repaired
    (tmp_path / "in.mcap").write_bytes((folder / "in.mcap").read_bytes())
    (tmp_path / "link.mcap").hardlink_to(tmp_path / "in.mcap")
    (tmp_path / "out.mcap.part").write_bytes((folder / "in.mcap").read_bytes())
    (tmp_path / "there.mcap").write_text("mine")
    write_folders(tmp_path / "rig", 2)
    before = {path: digest(path) for path in tmp_path.rglob("*") if path.is_file()}
    done = inside("repair", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert {path: digest(path) for path in tmp_path.rglob("*") if path.is_file()} == before


def test_force_replaces_what_is_there_only_when_all_went_well(repaired, tmp_path):
    folder, _ = repaired
    (tmp_path / "there.mcap").write_text("mine")
    missing = ("--set", "source.cameras=[a]")
    assert inside("repair", folder / "in.mcap", "there.mcap", "--force", *missing, cwd=tmp_path).returncode == 2
    assert (tmp_path / "there.mcap").read_text() == "mine"
    quick = ("--set", "detectors={timestamp: {}}")
    assert inside("repair", folder / "in.mcap", "there.mcap", "--force", *quick, cwd=tmp_path).returncode == 0
    assert len(replayed(tmp_path / "there.mcap")) > 200
    assert [path.name for path in tmp_path.iterdir()] == ["there.mcap"]
