"""What the offset detector keeps of a rig, what it costs, and how it closes loops of cameras."""

from __future__ import annotations

import pytest

from pipeline.detectors.offset.budget import Budget
from pipeline.detectors.offset.loops import closed, measured_pairs
from pipeline.detectors.offset.weigh import Finding
from pipeline.frame import NS_PER_MS, Pair
from tests.observe import observed, pictures, rendered
from tests.programs import inside, lines_of

WALK = "rig: bench\nsource: {type: synthetic, motion: handheld, duration_s: 5, width: 320, height: 240, speed: max}\n"
KEPT = "detectors: {offset: {rig: learned.yaml}}\nsinks: {}\n"


def run(folder, extra=""):
    (folder / "rig.yaml").write_text(WALK + KEPT + extra)
    return inside("run", "rig.yaml", cwd=folder)


def test_what_was_learned_in_sync_is_kept_and_taken_up_again(tmp_path):
    done = run(tmp_path)
    assert done.returncode == 0, done.stderr
    kept = (tmp_path / "learned.yaml").read_text()
    assert "syncwatch.rig.v1" in kept
    assert "left-right" in kept
    assert run(tmp_path).returncode == 0


def test_nothing_is_kept_of_a_rig_that_is_out_of_sync(tmp_path):
    done = run(tmp_path, "faults: [{type: content_shift, camera: right, frames: 1}]\n")
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "learned.yaml").exists()


@pytest.mark.parametrize("setting", ["rig", "calibration"])
def test_a_file_that_is_something_else_is_one_line_and_status_2(tmp_path, setting):
    (tmp_path / "broken.yaml").write_text("{what: is this")
    (tmp_path / "rig.yaml").write_text(WALK + f"detectors: {{offset: {{{setting}: broken.yaml}}}}\nsinks: {{}}\n")
    done = inside("run", "rig.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "broken.yaml" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_calibration_that_is_missing_is_one_line_and_status_2(tmp_path):
    (tmp_path / "rig.yaml").write_text(WALK + "detectors: {offset: {calibration: none.yaml}}\nsinks: {}\n")
    done = inside("run", "rig.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "none.yaml" in done.stderr


def test_a_calibration_is_taken_as_a_start_on_real_pictures(recordings, tmp_path):
    rows = [["1", "0", "0", "0", "0", "1", "0", "0", "0", "0", "1", "0"] for _ in range(2)]
    for row, shift in zip(rows, (0.0, -386.1), strict=True):
        row[0] = row[5] = "718.856"
        row[2], row[6], row[3] = "607.1928", "185.2157", str(shift)
    (tmp_path / "calib.txt").write_text("".join(f"P{n}: {' '.join(row)}\n" for n, row in enumerate(rows)))
    calibration = f"detectors.offset.calibration={tmp_path / 'calib.txt'}"
    done = inside(
        "replay", recordings / "kitti_odo_seq1", "--fps", "10", "--set", calibration, "--jsonl", "-", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    states = [line["content"]["state"] for line in lines_of(done.stdout)]
    assert states[20:].count("sync") > 25


def test_a_share_of_a_core_leaves_windows_out_and_says_so(tmp_path):
    (tmp_path / "rig.yaml").write_text(
        WALK + "detectors: {offset: {cpu_percent: 1}}\nsinks: {jsonl: {path: out.jsonl}}\n"
    )
    assert inside("run", "rig.yaml", cwd=tmp_path).returncode == 0
    reasons = [line["evidence"]["offset"]["reason"] for line in lines_of((tmp_path / "out.jsonl").read_text())]
    assert sum(reason == "not looked at: over 1 % of a core" for reason in reasons) > len(reasons) / 2


def test_a_budget_is_kept_to_over_time():
    now_ns = 0
    budget = Budget(0.25, 40 * NS_PER_MS, lambda: now_ns)
    looked = 0
    for index in range(400):
        if budget.allows(index):
            looked += 1
            with budget:
                now_ns += 30 * NS_PER_MS
    assert now_ns == pytest.approx(0.25 * 400 * 40 * NS_PER_MS, rel=0.1)
    assert looked > 100


def found(tau, sigma=0.01):
    return Finding(tau, sigma, "", "points in both views")


PERIODS = dict.fromkeys("abcd", 40 * NS_PER_MS)


def test_with_three_cameras_each_is_measured_with_the_next():
    pairs = [Pair("a", "b"), Pair("a", "c")]
    assert measured_pairs(pairs, "abc") == [("a", "b"), ("a", "c"), ("b", "c")]
    assert measured_pairs(pairs[:1], "ab") == [("a", "b")]


def test_a_loop_that_closes_makes_each_pair_surer():
    result = closed({("a", "b"): found(0.1), ("b", "c"): found(0.2), ("a", "c"): found(0.31)}, PERIODS)
    assert result["a", "c"].sigma < 0.01
    assert result["a", "b"].tau + result["b", "c"].tau == pytest.approx(result["a", "c"].tau)


def test_a_pair_without_common_view_is_told_by_way_of_others():
    silent = Finding(None, None, "views do not overlap")
    result = closed({("a", "b"): found(0.1), ("b", "c"): found(0.2), ("a", "c"): silent}, PERIODS)
    assert result["a", "c"].tau == pytest.approx(0.3)
    assert result["a", "c"].sigma == pytest.approx(0.01 * 2**0.5)
    assert result["a", "c"].known


def test_a_loop_that_does_not_close_silences_its_pairs():
    result = closed({("a", "b"): found(0.1), ("b", "c"): found(0.2), ("a", "c"): found(0.8)}, PERIODS)
    assert {item.why for item in result.values()} == {"offsets of a, b, c do not add up"}
    assert not any(item.known for item in result.values())


def test_of_four_cameras_the_one_that_does_not_fit_is_named():
    true = {"a": 0.0, "b": 0.1, "c": 0.2, "d": 0.3}
    pairs = [(x, y) for x in "abcd" for y in "abcd" if x < y]
    told = {(x, y): found(true[y] - true[x]) for x, y in pairs}
    told["a", "d"], told["b", "d"] = found(0.7), found(-0.4)
    result = closed(told, PERIODS)
    assert result["a", "b"].known
    assert "d does not fit" in result["a", "d"].why


def test_pairs_that_nothing_connects_stay_silent():
    silent = Finding(None, None, "nothing moves")
    result = closed({("a", "b"): found(0.1), ("b", "c"): silent, ("a", "c"): silent}, PERIODS)
    assert result["b", "c"].why == "nothing moves"


def test_halves_of_the_points_are_measured_on_request():
    left, right = pictures(rendered(motion="handheld", duration_s=1.5), 42)
    numbers = observed(left, right, 30, halves=True)[-2].numbers
    assert abs(numbers["odd_frames"] - numbers["even_frames"]) < 0.05
