"""Which trials are run, and what findings come to."""

from __future__ import annotations

from collections import Counter

import pytest

from pipeline.frame import Camera, Pair, Rig
from pipeline.selftest.findings import Finding, Outcome
from pipeline.selftest.proof import Conclusion, Proof
from pipeline.selftest.summary import Summary
from pipeline.selftest.trials import loops, moves


def pairs(*names: str) -> list[Pair]:
    return [Pair(*name.split("-")) for name in names]


@pytest.mark.parametrize(
    "of_rig",
    [
        ("a-b",),
        ("a-b", "a-c", "a-d"),
        ("a-b", "b-c", "c-d"),
        ("b-a", "c-a"),
        ("a-b", "b-c", "a-c"),
        ("c-d", "a-b", "b-c"),
    ],
)
def test_the_cameras_of_every_pair_are_moved_differently(of_rig):
    steps = moves(pairs(*of_rig))
    assert all(steps[pair.first] != steps[pair.second] for pair in pairs(*of_rig))
    assert max(map(abs, steps.values())) == 1


def test_two_cameras_have_no_loop_and_four_have_two():
    def rig(names: str) -> Rig:
        return Rig("bench", tuple(Camera(name, 30) for name in names), ())

    assert loops(rig("ab")) == []
    assert [[pair.name for pair in loop] for loop in loops(rig("abcd"))] == [
        ["a-b", "b-c", "a-c"],
        ["a-c", "c-d", "a-d"],
    ]


def proof(**outcomes: dict[str, Outcome]) -> Proof:
    return Proof(
        "bench",
        33.3,
        tuple(Summary(pair, 100, Counter(), None, None, (), "") for pair in outcomes),
        tuple(Finding(test, pair, outcome, "") for pair, tests in outcomes.items() for test, outcome in tests.items()),
    )


GOOD = {"shift by +1": Outcome.PASSED, "shift by -2": Outcome.NOT_SHOWN, "swap": Outcome.PASSED}


def test_a_shift_and_the_swap_prove_it():
    assert proof(ab=GOOD).conclusion is Conclusion.PROVED


@pytest.mark.parametrize("missing", ["shift by +1", "swap"])
def test_without_a_shift_or_the_swap_nothing_is_proved(missing):
    assert proof(ab={**GOOD, missing: Outcome.NOT_SHOWN}).conclusion is Conclusion.NOT_PROVED


def test_one_failure_of_anything_is_a_contradiction():
    assert proof(ab=GOOD, ac={"odd / even points": Outcome.FAILED}).conclusion is Conclusion.CONTRADICTED


def test_a_pair_without_proof_is_named():
    found = proof(ab=GOOD, ac={})
    assert (found.conclusion, found.without_proof) == (Conclusion.NOT_PROVED, ("ac",))
