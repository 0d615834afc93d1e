"""What counts as right, and for how much."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from pipeline.evaluate.score import Row, Score, score
from pipeline.verdict import State

SYNC, ASYNC, UNKNOWN = State.SYNC, State.ASYNC, State.UNKNOWN


def rows(*said: tuple[float, float | None], sigma: float | None = None) -> list[Row]:
    """Truth and measured offset of each frame, in frames; None abstains."""

    def state(offset: float | None) -> State:
        return UNKNOWN if offset is None else ASYNC if offset else SYNC

    return [
        Row(frame, truth, state(truth), state(told), told, sigma, state(told))
        for frame, (truth, told) in enumerate(said)
    ]


def scored(given_rows: list[Row], **options: float) -> Score:
    return score(Score("r", "m", 0), given_rows, **{"fps": 10, "warm_up_s": 0, "warm_up_frames": 20, **options})


def test_the_warm_up_does_not_count_but_is_never_more_than_a_third():
    assert scored(rows(*[(0, 0)] * 300), warm_up_s=5).windows == 250
    assert scored(rows(*[(0, 0)] * 300)).windows == 280
    assert scored(rows(*[(0, 0)] * 30)).windows == 20


def test_abstaining_is_neither_right_nor_wrong():
    result = scored(rows(*[(1.0, None)] * 60))
    assert (result.windows, result.decided, result.false_sync, result.errors) == (40, 0, 0, [])


def test_whole_frames_and_small_errors_are_counted_apart():
    result = scored(rows(*[(0.25, 0.30)] * 30, *[(0.25, 0.45)] * 30))
    assert (result.whole_right, result.small_error) == (40, 10)


def test_confident_errors_are_counted_by_their_kind():
    result = scored(rows(*[(0, 1.0)] * 30, *[(1.0, 0)] * 30))
    assert (result.false_async, result.false_sync) == (10, 30)


def test_two_sigma_holds_the_truth_or_not():
    result = scored(rows(*[(0, 0.1)] * 30, *[(0, 0.3)] * 30, sigma=0.1))
    assert (result.with_sigma, result.within_two_sigma) == (40, 10)


def test_a_step_is_found_after_so_many_frames():
    result = scored(rows(*[(0, 0)] * 40, *[(1, 0)] * 3, *[(1, 1)] * 20))
    assert (result.steps, result.delays) == (1, [3])


def test_a_step_that_is_never_told_is_not_found():
    result = scored(rows(*[(0, 0)] * 40, *[(1, 0)] * 10, *[(0, 0)] * 5, *[(0, 1)] * 5))
    assert (result.steps, result.delays) == (1, [])


def test_a_step_told_before_it_happens_is_not_found():
    result = scored(rows(*[(0, 0)] * 30, *[(0, 1)] * 10, *[(1, 1)] * 20))
    assert (result.steps, result.delays, result.false_async) == (1, [], 10)


def test_without_a_warm_up_every_frame_counts():
    result = scored(rows(*[(0, 0)] * 12, *[(0, 1)] * 3, *[(0, None)] * 2), warm_up_frames=0)
    assert result.windows == 17
    assert result.verdicts == {"sync": 12, "async": 3, "unknown": 2}


def test_json_tells_quantiles_of_errors_and_sigmas_not_all_of_them():
    told = scored(rows(*[(0, 0.02)] * 59, (0, 0.2), sigma=0.03)).to_json()
    assert (told["error_median_frames"], told["error_p95_frames"], told["sigma_median_frames"]) == (0.02, 0.02, 0.03)
    assert not {"errors", "sigmas"} & told.keys()


@given(st.lists(st.tuples(st.sampled_from([0.0, 1.0]), st.sampled_from([0.0, 1.0, None])), max_size=80))
def test_counts_add_up(said):
    result = scored(rows(*said))
    assert result.decided == result.measured <= result.windows <= len(said)
    assert result.whole_right + result.false_async + result.false_sync == result.decided
