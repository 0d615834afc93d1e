"""What is ruled of one pair at one frame: by the report's rule, or by weighing what its witnesses say."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pipeline.belief import MOST_PICTURES, MOST_STAMPS, Belief
from pipeline.causes import Situation, SteadyCause, cause_of
from pipeline.clocks import middle_of_exposure_ns, start_of_exposure_ns
from pipeline.drift import Drift, tell_drift
from pipeline.frame import NS_PER_S, Frame, Pair, Rig, Window
from pipeline.health.observer import Observation
from pipeline.notes import Note
from pipeline.range_error import RangeCase, range_error
from pipeline.steady import JUMP_FRAMES
from pipeline.verdict import Basis, Cause, Evidence, Pace, PairTruth, Reason, State, Verdict
from pipeline.witness import PictureWitness, StampWitness, Testimony, best_of, of_basis

TELLING = (Reason.STAMPS_DISPROVED, Reason.WARMING_UP)
"""Why stamps do not speak, where that says more than why pictures do not."""

PICTURES_LAG_S = 0.5
"""How far pictures may lag behind a drift: the windows they are judged by go back for half a second."""


@dataclass(frozen=True, slots=True)
class Ruling:
    """What is said of a pair at one frame, and the evidence that decided, if any did. camera: the one to blame."""

    state: State = State.UNKNOWN
    cause: Cause | None = None
    reason: Reason | None = None
    decisive: Evidence | None = None
    camera: str | None = None
    since_frame: int | None = None
    pace: Pace = field(default_factory=Pace)
    notes: tuple[Note, ...] = ()

    @property
    def basis(self) -> Basis:
        if self.decisive is not None:
            return self.decisive.basis
        return Basis.CONTENT if self.cause is Cause.FROZEN else Basis.NONE


class PairJudge(ABC):
    """Judges one pair."""

    def __init__(self, rig: Rig, pair: Pair, tolerance_ns: int, range_of: RangeCase | None) -> None:
        self._rig = rig
        self._pair = pair
        self._period_ns = rig.camera(pair.first).period_ns
        self._tolerance_ns = tolerance_ns
        self._range = range_of
        self._number: int | None = None

    @property
    def name(self) -> str:
        return self._pair.name

    def judge(self, window: Window, evidence: Sequence[Evidence], seen: Observation) -> Verdict | None:
        """The verdict of a window; None where there is nothing to say of a hole of the first camera."""
        first, second = (window.cameras[name].current for name in (self._pair.first, self._pair.second))
        self._number = window.cameras[self._pair.first].number
        if first is None:
            return self.first_is_silent(seen)
        ruling = self.unpaired(seen) if second is None else self.rule(first, second, evidence, seen)
        return self.verdict(ruling, evidence, seen, self._number, first, second)

    @abstractmethod
    def rule(self, first: Frame, second: Frame, evidence: Sequence[Evidence], seen: Observation) -> Ruling:
        """Of two frames that came together."""

    def unpaired(self, seen: Observation) -> Ruling:  # noqa: ARG002 - whoever regards health does
        """Of a frame of the first camera without partner."""
        return Ruling(reason=Reason.UNPAIRED, notes=(Note.UNPAIRED,))

    def first_is_silent(self, seen: Observation) -> Verdict | None:  # noqa: ARG002 - as above
        """Of a window without a frame of the first camera."""
        return None

    def silence(self, seen: Observation) -> Verdict | None:  # noqa: ARG002 - as above
        """While no window comes."""
        return None

    def verdict(
        self,
        ruling: Ruling,
        evidence: Sequence[Evidence],
        seen: Observation,
        number: int | None = None,
        first: Frame | None = None,
        second: Frame | None = None,
    ) -> Verdict:
        told = ruling.decisive
        offset_ns = None if told is None else told.offset_ns
        away_ns = None if offset_ns is None else offset_ns - self._pair.expected_offset_ns
        noted = [note for item in evidence for note in item.notes]
        observed = [note for name in (self._pair.first, self._pair.second) for note in seen.notes(name)]
        return Verdict(
            rig=self._rig.name,
            pair=self._pair.name,
            frame=number,
            state=ruling.state,
            basis=ruling.basis,
            cause=ruling.cause,
            reason=ruling.reason,
            camera=ruling.camera,
            since_frame=ruling.since_frame,
            offset_ns=offset_ns,
            sigma_ns=None if told is None else told.sigma_ns,
            offset_frames=None if told is None else told.offset_frames,
            tolerance_ns=self._tolerance_ns,
            drift=ruling.pace,
            range_error=None if self._range is None or away_ns is None else range_error(self._range, away_ns),
            content=best_of(of_basis(evidence, Basis.CONTENT)),
            evidence=tuple(evidence),
            sequence=self._by_camera(first, second, lambda frame: frame.sequence),
            captured_ns=self._by_camera(first, second, lambda frame: frame.captured_ns),
            notes=tuple(dict.fromkeys((*noted, *(note.value for note in (*ruling.notes, *observed))))),
            truth=self._truth(first, second),
            **_exposures(first, second),
        )

    def _by_camera(
        self, first: Frame | None, second: Frame | None, value: Callable[[Frame], int | None]
    ) -> Mapping[str, int | None]:
        frames = {self._pair.first: first, self._pair.second: second}
        return {name: None if frame is None else value(frame) for name, frame in frames.items()}

    def _truth(self, first: Frame | None, second: Frame | None) -> PairTruth | None:
        if first is None or second is None or first.truth is None or second.truth is None:
            return None
        offset_ns = second.truth.shown_ns - first.truth.shown_ns
        off = abs(offset_ns - self._pair.expected_offset_ns) > self._tolerance_ns
        faults = dict.fromkeys((*first.truth.faults, *second.truth.faults))
        assumed = first.truth.assumed or second.truth.assumed
        return PairTruth(offset_ns, State.ASYNC if off else State.SYNC, tuple(faults), assumed)


class ClassicPair(PairJudge):
    """The report's conjunction, literally: frame by frame, every detector alike, without regard to health."""

    def rule(self, first: Frame, second: Frame, evidence: Sequence[Evidence], seen: Observation) -> Ruling:  # noqa: ARG002
        """The first that says async, else the last if all say sync, else nothing."""
        decisive = next((item for item in evidence if item.state is State.ASYNC), None)
        if decisive is not None:
            frames = (decisive.offset_frames or 0.0) - self._pair.expected_offset_ns / self._period_ns
            return Ruling(State.ASYNC, cause_of(Situation(frames=frames)), decisive=decisive)
        if evidence and all(item.state is State.SYNC for item in evidence):
            return Ruling(State.SYNC, decisive=evidence[-1])
        return Ruling(reason=Reason.NO_EVIDENCE)


class WeighedPair(PairJudge):
    """Pictures decide where they can; else stamps, held to the tolerance of synchronization; else nothing.

    Both feed one belief, and what is believed is said on every frame that bears evidence. A frozen or missing camera is
    out of sync whatever else is said.
    """

    def __init__(
        self, rig: Rig, pair: Pair, tolerance_ns: int, range_of: RangeCase | None, *, trust_stamps: bool
    ) -> None:
        super().__init__(rig, pair, tolerance_ns, range_of)
        self._stamps = StampWitness(pair, rig, tolerance_ns, trust_synthesised=trust_stamps)
        self._pictures = PictureWitness(pair, rig, tolerance_ns)
        self._belief = Belief()
        self._cause = SteadyCause()
        self._said = Ruling()
        self._since: int | None = None
        self._doubted_since: int | None = None
        self._windows_a_second = max(1, round(rig.camera(pair.first).fps))
        self._silent_windows = 0
        self._second_told = False

    def first_is_silent(self, seen: Observation) -> Verdict | None:
        """One verdict when the camera is found missing, and one a second of the windows that others go on to fill."""
        if not seen.has(self._pair.first, Note.MISSING):
            self._silent_windows = 0
            return None
        due = self._silent_windows % self._windows_a_second == 0
        self._silent_windows += 1
        return self.silence(seen) if due else None

    def silence(self, seen: Observation) -> Verdict | None:
        """Of the second camera once: frames of the first tell of it as soon as they are no longer held for it."""
        if seen.has(self._pair.first, Note.MISSING):
            return self.verdict(Ruling(State.ASYNC, Cause.MISSING, camera=self._pair.first), [], seen)
        if not seen.has(self._pair.second, Note.MISSING) or self._second_told:
            return None
        self._second_told = True
        return self.verdict(Ruling(State.ASYNC, Cause.MISSING, camera=self._pair.second), [], seen)

    def unpaired(self, seen: Observation) -> Ruling:
        if seen.has(self._pair.second, Note.MISSING):
            self._second_told = True
            return Ruling(State.ASYNC, Cause.MISSING, camera=self._pair.second)
        return super().unpaired(seen)

    def rule(self, first: Frame, second: Frame, evidence: Sequence[Evidence], seen: Observation) -> Ruling:
        self._second_told = False
        stamps = self._stamps.see(first, second, of_basis(evidence, Basis.TIMESTAMPS))
        frozen = self._which(Note.FROZEN, seen)
        if frozen is not None:
            ruling = Ruling(State.ASYNC, Cause.FROZEN, camera=frozen)
        else:
            ruling = self._weigh(self._pictures_say(first, evidence, seen), stamps)
        return replace(ruling, pace=self._pace(), notes=self._notes(ruling))

    def _which(self, note: Note, seen: Observation) -> str | None:
        return next((name for name in (self._pair.first, self._pair.second) if seen.has(name, note)), None)

    def _pictures_say(self, first: Frame, evidence: Sequence[Evidence], seen: Observation) -> Testimony | Reason:
        if self._which(Note.DARK, seen) is not None:
            return Reason.DARK
        said = self._pictures.see(first, best_of(of_basis(evidence, Basis.CONTENT)), self._lag_ns)
        if isinstance(said, Testimony):
            self._stamps.compare(said)
        return said

    def _weigh(self, pictures: Testimony | Reason, stamps: Testimony | Reason) -> Ruling:
        if isinstance(pictures, Testimony):
            return self._rest_on(pictures)
        if isinstance(stamps, Testimony):
            return self._rest_on(stamps)
        return Ruling(reason=stamps if stamps in TELLING else pictures)

    def _rest_on(self, witness: Testimony) -> Ruling:
        """What is believed; a frame that contradicts it adds its doubt, and what was said before is said once more."""
        of_pictures = witness.evidence.basis is Basis.CONTENT
        before = self._belief.state
        if self._doubted_since is None:
            self._doubted_since = self._number
        state = self._belief.add(witness.support, MOST_PICTURES if of_pictures else MOST_STAMPS)
        if state is not before:
            self._since = self._doubted_since
        elif state is State.ASYNC and self._jumps(witness):
            self._since = self._number
        if state is State.UNKNOWN:
            return Ruling(reason=Reason.WARMING_UP)
        if (state is State.ASYNC) == (witness.support > 0):
            self._doubted_since = None
            self._said = replace(self._ruling(state, witness), since_frame=self._since)
        return self._said

    def _jumps(self, witness: Testimony) -> bool:
        """Whether the cameras are now apart in another way."""
        said = self._said.decisive
        if said is None or said.offset_frames is None or self._said.cause is Cause.FREE_RUN:
            return False
        return abs(witness.offset_ns / self._period_ns - said.offset_frames) > JUMP_FRAMES

    def _ruling(self, state: State, witness: Testimony) -> Ruling:
        decisive = replace(
            witness.evidence,
            offset_ns=round(witness.offset_ns),
            offset_frames=witness.offset_ns / self._period_ns,
            sigma_ns=None if witness.sigma_ns is None else round(witness.sigma_ns),
        )
        if state is State.SYNC:
            self._cause.clear()
            return Ruling(state, decisive=decisive)
        return Ruling(state, self._cause.add(cause_of(self._situation(witness))), decisive=decisive)

    def _situation(self, witness: Testimony) -> Situation:
        by_pictures = witness.evidence.basis is Basis.CONTENT
        return Situation(
            by_pictures=by_pictures,
            stamps_differ=by_pictures and self._stamps.differ_from(witness, self._lag_ns),
            drifting=self._stamps.drifting or (by_pictures and self._pictures.drifting),
            frames=(witness.offset_ns - self._pair.expected_offset_ns) / self._period_ns,
            sigma_frames=(witness.sigma_ns or 0.0) / self._period_ns,
        )

    @property
    def _lag_ns(self) -> float:
        """How much the offset has grown, by the stamps, since what pictures tell of."""
        return abs(self._stamps.slope) * PICTURES_LAG_S * NS_PER_S

    def _pace(self) -> Pace:
        return Pace(*_ppm(self._stamps.drift), *_ppm(self._pictures.drift))

    def _notes(self, ruling: Ruling) -> tuple[Note, ...]:
        """The clocks' notes; a drift of the cameras themselves is no drift of a clock."""
        reading = self._stamps.reading
        drifts = tell_drift(self._stamps.drift, self._pictures.drift)
        of_camera = ruling.cause is Cause.FREE_RUN or isinstance(drifts, Cause)
        clocks = () if reading is None else reading.notes
        if ruling.state is State.SYNC and self._stamps.biased:
            clocks = (*clocks, Note.STAMP_REFERENCE)
        return (*ruling.notes, *(note for note in clocks if not (note is Note.CLOCK_DRIFT and of_camera)))


def _exposures(first: Frame | None, second: Frame | None) -> dict[str, int | None]:
    if first is None or second is None:
        return {}
    moments = {"exposure_start_ns": start_of_exposure_ns, "exposure_middle_ns": middle_of_exposure_ns}
    told = {name: (moment(first), moment(second)) for name, moment in moments.items()}
    return {name: None if one is None or other is None else other - one for name, (one, other) in told.items()}


def _ppm(drift: Drift | None) -> tuple[float | None, float | None]:
    return (None, None) if drift is None else (drift.ppm, drift.sigma_ppm)
