"""The only file that knows all kinds: builds a running pipeline from a checked configuration."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TextIO

from pipeline.align import Aligner
from pipeline.buffer import WindowBuffer
from pipeline.conditions import Conditions
from pipeline.config import PairSettings
from pipeline.configtext.document import Problem
from pipeline.detectors.adaptive_window import AdaptiveWindowDetector, AdaptiveWindowSettings
from pipeline.detectors.epipolar_classes import EpipolarClassesDetector, EpipolarClassesSettings
from pipeline.detectors.offset.detector import OffsetDetector
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.detectors.orb import OrbDetector, OrbSettings
from pipeline.detectors.spatial import SpatialDetector, SpatialSettings
from pipeline.detectors.timestamp import TimestampDetector, TimestampSettings
from pipeline.detectors.weighted_template import WeightedTemplateDetector, WeightedTemplateSettings
from pipeline.errors import InputError
from pipeline.event_log import read_events
from pipeline.faults.base import Fault
from pipeline.faults.content_shift import ContentShift, ContentShiftSettings
from pipeline.faults.dark import Dark, DarkSettings
from pipeline.faults.drop import Drop, DropSettings
from pipeline.faults.exposure import Exposure, ExposureSettings
from pipeline.faults.frame_repeat import FrameRepeat, FrameRepeatSettings
from pipeline.faults.free_run import FreeRun, FreeRunSettings
from pipeline.faults.frozen import Frozen, FrozenSettings
from pipeline.faults.knock import Knock, KnockSettings
from pipeline.faults.missing import Dead, DeadSettings, Truncate, TruncateSettings
from pipeline.faults.seq_offset import SeqOffset, SeqOffsetSettings
from pipeline.faults.seq_wrap import SeqWrap, SeqWrapSettings
from pipeline.faults.slip import Slip, SlipSettings
from pipeline.faults.source import FaultedSource
from pipeline.faults.stamp_drift import StampDrift, StampDriftSettings
from pipeline.faults.stamps import (
    CopyStamp,
    CopyStampSettings,
    StampJitter,
    StampJitterSettings,
    StampOffset,
    StampOffsetSettings,
    StampRepeat,
    StampRepeatSettings,
)
from pipeline.faults.swap import Swap, SwapSettings
from pipeline.found import Finder
from pipeline.frame import NS_PER_MS, Camera, Detector, Pair, Renderer, Rig, Source
from pipeline.geometry.rig import RigGeometry
from pipeline.health.observer import Observer
from pipeline.judge import Judge
from pipeline.plan import Kind, Kinds, Plan, Several
from pipeline.range_error import RangeCase, range_case
from pipeline.run import Parts
from pipeline.status import StatusKeeper
from pipeline.steady import CONFIRM, WEIGHED
from pipeline.verdict import Level, Message, Report, Sink
from sinks.console import ConsoleSettings, ConsoleSink
from sinks.events import EventsSettings, EventsSink
from sinks.jsonl import JsonlSettings, JsonlSink
from sinks.mcap.settings import McapSettings
from sinks.mcap.sink import McapSink
from sinks.pictures import PicturesSettings, PicturesSink
from sinks.prometheus import PrometheusSettings, PrometheusSink
from sinks.ros2.sink import Ros2Settings, Ros2Sink
from sinks.zenoh import ZenohSettings, ZenohSink
from sources.oak.listing import oak_cameras, oak_source
from sources.oak.settings import OakSettings
from sources.oak.source import OakSource
from sources.push import PushSettings, PushSource
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from sources.several import SeveralSources
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from sources.v4l2.listing import v4l2_cameras, v4l2_source
from sources.v4l2.settings import V4l2Settings
from sources.v4l2.source import V4l2Source
from sources.video.settings import VideoSettings
from sources.video.source import VideoSource
from sources.zenoh.settings import ZenohSourceSettings
from sources.zenoh.source import ZenohSource


@dataclass(frozen=True, slots=True)
class SinkContext:
    """What sinks may want to know besides their settings."""

    plan: Plan
    rig: Rig
    frame_count: int | None
    console: TextIO
    live: bool
    wall_ns: Callable[[], int]
    monotonic_ns: Callable[[], int]


def _offset_detector(settings: OffsetSettings, *, name: str, rig: Rig, plan: Plan, **_: object) -> OffsetDetector:
    tolerance = plan.config.judge.sync_tolerance_ms
    return OffsetDetector(
        settings,
        name=name,
        rig=rig,
        base=plan.base,
        version=version(),
        sync_tolerance_ms=None if tolerance == "auto" else tolerance,
    )


def _mcap_sink(settings: McapSettings, context: SinkContext) -> McapSink:
    return McapSink(
        settings,
        base=context.plan.base,
        rig=context.rig,
        detectors=list(context.plan.detectors),
        version=version(),
        live=context.live,
        wall_ns=context.wall_ns,
        monotonic_ns=context.monotonic_ns,
    )


def _past_events(context: SinkContext) -> list[Message]:
    """What a sink `events` of this configuration has kept of former runs of this rig. Raises InputError."""
    for chosen in context.plan.sinks.values():
        if isinstance(chosen.settings, EventsSettings):
            file = chosen.settings.file(context.plan.base, context.rig.name)
            return [one for one in read_events(file, chosen.settings.keep) if one.get("rig") == context.rig.name]
    return []


def _several(builds: Sequence[Callable[..., Source]], settings: Several, plan: Plan) -> SeveralSources:
    return SeveralSources(
        [build(one, plan) for build, one in zip(builds, settings.sources, strict=True)],
        refuse=lambda number, text: plan.document.error([Problem(("source", number), text)]),
        pairing=plan.config.buffer,
    )


def version() -> str:
    return metadata.version("syncwatch")


KINDS = Kinds(
    tables={
        "source": {
            "synthetic": Kind(SyntheticSettings, lambda s, plan: SyntheticSource(s, seed=plan.config.seed)),
            "replay": Kind(ReplaySettings, lambda s, plan: ReplaySource(s, base=plan.base)),
            "oak": Kind(OakSettings, lambda s, _: OakSource(s)),
            "push": Kind(PushSettings, lambda s, _: PushSource(s)),
            "zenoh": Kind(ZenohSourceSettings, lambda s, plan: ZenohSource(s, base=plan.base)),
            "v4l2": Kind(V4l2Settings, lambda s, _: V4l2Source(s)),
            "video": Kind(VideoSettings, lambda s, plan: VideoSource(s, base=plan.base)),
        },
        "faults": {
            "slip": Kind(SlipSettings, lambda s, c, seed, r: Slip(s.type, s, c, seed, s.frames, r)),
            "content_shift": Kind(
                ContentShiftSettings, lambda s, c, seed, r: ContentShift(s.type, s, c, seed, s.frames, r)
            ),
            "seq_offset": Kind(SeqOffsetSettings, lambda s, c, seed, _: SeqOffset(s, c, seed)),
            "drop": Kind(DropSettings, lambda s, c, seed, _: Drop(s, c, seed)),
            "frozen": Kind(FrozenSettings, lambda s, c, seed, _: Frozen(s, c, seed)),
            "stamp_drift": Kind(StampDriftSettings, lambda s, c, seed, _: StampDrift(s, c, seed)),
            "stamp_offset": Kind(StampOffsetSettings, lambda s, c, seed, _: StampOffset(s, c, seed)),
            "stamp_jitter": Kind(StampJitterSettings, lambda s, c, seed, _: StampJitter(s, c, seed)),
            "stamp_repeat": Kind(StampRepeatSettings, lambda s, c, seed, _: StampRepeat(s, c, seed)),
            "copy_stamp": Kind(CopyStampSettings, lambda s, c, seed, _: CopyStamp(s, c, seed)),
            "free_run": Kind(FreeRunSettings, lambda s, c, seed, _: FreeRun(s, c, seed)),
            "frame_repeat": Kind(FrameRepeatSettings, lambda s, c, seed, _: FrameRepeat(s, c, seed)),
            "seq_wrap": Kind(SeqWrapSettings, lambda s, c, seed, _: SeqWrap(s, c, seed)),
            "swap": Kind(SwapSettings, lambda s, c, seed, _: Swap(s, c, seed)),
            "truncate": Kind(TruncateSettings, lambda s, c, seed, _: Truncate(s, c, seed)),
            "knock": Kind(KnockSettings, lambda s, c, seed, _: Knock(s, c, seed)),
            "dark": Kind(DarkSettings, lambda s, c, seed, _: Dark(s, c, seed)),
            "exposure": Kind(ExposureSettings, lambda s, c, seed, _: Exposure(s, c, seed)),
            "dead": Kind(DeadSettings, lambda s, c, seed, _: Dead(s, c, seed)),
        },
        "detectors": {
            "timestamp": Kind(
                TimestampSettings,
                lambda s, *, name, rig, classic, **_: TimestampDetector(s, name=name, rig=rig, classic=classic),
            ),
            "offset": Kind(OffsetSettings, _offset_detector),
            "spatial": Kind(SpatialSettings, lambda s, *, name, rig, **_: SpatialDetector(s, name=name, rig=rig)),
            "adaptive_window": Kind(
                AdaptiveWindowSettings, lambda s, *, name, rig, **_: AdaptiveWindowDetector(s, name=name, rig=rig)
            ),
            "weighted_template": Kind(
                WeightedTemplateSettings, lambda s, *, name, rig, **_: WeightedTemplateDetector(s, name=name, rig=rig)
            ),
            "orb": Kind(OrbSettings, lambda s, *, name, rig, **_: OrbDetector(s, name=name, rig=rig)),
            "epipolar_classes": Kind(
                EpipolarClassesSettings, lambda s, *, name, rig, **_: EpipolarClassesDetector(s, name=name, rig=rig)
            ),
        },
        "sinks": {
            "console": Kind(
                ConsoleSettings,
                lambda s, k: ConsoleSink(s, stream=k.console, rig=k.rig, frame_count=k.frame_count),
            ),
            "events": Kind(EventsSettings, lambda s, k: EventsSink(s, base=k.plan.base, rig=k.rig.name)),
            "jsonl": Kind(JsonlSettings, lambda s, k: JsonlSink(s, base=k.plan.base)),
            "mcap": Kind(McapSettings, _mcap_sink),
            "pictures": Kind(PicturesSettings, lambda s, k: PicturesSink(s, rig=k.rig.name, base=k.plan.base)),
            "prometheus": Kind(PrometheusSettings, lambda s, k: PrometheusSink(s, rig=k.rig.name, version=version())),
            "ros2": Kind(Ros2Settings, lambda s, k: Ros2Sink(s, rig=k.rig.name, base=k.plan.base)),
            "zenoh": Kind(
                ZenohSettings,
                lambda s, k: ZenohSink(s, rig=k.rig.name, history=_past_events(k), base=k.plan.base),
            ),
        },
    },
    own={
        "source": lambda made: lambda s, _: made(s),
        "detectors": lambda made: lambda s, *, name, rig, **_: made(s, name=name, rig=rig),
        "sinks": lambda made: lambda s, k: made(s, rig=k.rig),
    },
    several=_several,
)

FINDERS: tuple[Finder, ...] = (Finder(v4l2_cameras, v4l2_source), Finder(oak_cameras, oak_source))
"""What looks for the cameras of this machine, in the order in which they are listed."""


def build_source(
    plan: Plan, *, wrap: Callable[[Source], Source] = lambda source: source, know_truth: bool = False
) -> Source:
    """The plan's source, with its faults injected, not yet open.

    wrap: what to put between the source and its faults. know_truth: note the truth on frames even without any fault.
    """
    source: Source = plan.source.build(plan.source.settings, plan)
    renderer = source if isinstance(source, Renderer) else None
    source = wrap(source)
    if not plan.faults and not know_truth:
        return source

    def make_faults(cameras: Sequence[Camera]) -> list[Fault]:
        return [_fault(plan, index, cameras, renderer) for index in range(len(plan.faults))]

    return FaultedSource(source, make_faults, plan.config.buffer, renderer)


def build_rig(plan: Plan, source: Source) -> Rig:
    """The rig of an open source, with its pairs. Raises ConfigError for a pair of cameras that do not exist."""
    cameras = source.cameras
    names = [camera.name for camera in cameras]
    if len(set(names)) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"the source has {', '.join(names) or 'no camera'}: two or more cameras of different names are needed"
        )
    told = getattr(source, "pairs", None)
    if plan.config.pairs is None and told:
        pairs = [Pair(first, second) for first, second in told]
    elif plan.config.pairs is None:
        pairs = [Pair(names[0], other) for other in names[1:]]
    else:
        problems = [
            _no_camera(("pairs", index), name, names)
            for index, entry in enumerate(plan.config.pairs)
            for name in entry.pair.split("-")
            if name not in names
        ]
        if problems:
            raise plan.document.error(problems)
        pairs = [_pair(entry) for entry in plan.config.pairs]
    return Rig(plan.config.rig, tuple(cameras), tuple(pairs))


def assemble(
    plan: Plan,
    source: Source,
    *,
    console: TextIO,
    on_report: Callable[[Report], None] = lambda _: None,
    wall_ns: Callable[[], int] = time.time_ns,
    monotonic_ns: Callable[[], int] = time.monotonic_ns,
) -> Parts:
    """Everything a run needs, around a source that is open.

    console: where sinks that talk to people print. on_report: called with everything that sinks get, before they do.
    """
    _keep_what_is_read(plan)
    rig = build_rig(plan, source)
    config = plan.config
    context = SinkContext(plan, rig, source.frame_count, console, source.live, wall_ns, monotonic_ns)
    classic = config.judge.combine == "classic"
    confirm = CONFIRM if classic else WEIGHED
    detectors: Mapping[str, Detector] = {
        name: chosen.build(chosen.settings, name=name, rig=rig, classic=classic, plan=plan)
        for name, chosen in plan.detectors.items()
    }
    sinks: Mapping[str, Sink] = {name: chosen.build(chosen.settings, context) for name, chosen in plan.sinks.items()}
    return Parts(
        source=source,
        buffer=WindowBuffer(rig.cameras, config.buffer),
        observer=Observer(rig.cameras),
        detectors=detectors,
        judge=Judge(
            config.judge,
            rig,
            trust_stamps=getattr(plan.source.settings, "trust_stamps", False),
            ranges=_ranges(plan, rig),
        ),
        aligner=None if config.align is None else Aligner(config.align, rig),
        geometry=None if classic else RigGeometry(rig),
        status=StatusKeeper(
            rig,
            unknown_is=Level(config.judge.unknown_is),
            version=version(),
            wall_ns=wall_ns,
            monotonic_ns=monotonic_ns,
            confirm=confirm,
        ),
        conditions=Conditions(rig, wall_ns, confirm=confirm),
        sinks=sinks,
        on_report=on_report,
    )


def _keep_what_is_read(plan: Plan) -> None:
    """Raises InputError for a sink that would write over the recording that is read."""
    settings = plan.source.settings
    sources = settings.sources if isinstance(settings, Several) else (settings,)
    read = [plan.base / path for one in sources for path in getattr(one, "paths", ())]
    for name, chosen in plan.sinks.items():
        told = getattr(chosen.settings, "path", None) or "-"
        target = plan.base / Path(told.replace("{rig}", plan.config.rig)).expanduser()
        if told != "-" and target.exists() and any(one.exists() and target.samefile(one) for one in read):
            raise InputError(f"sinks.{name}: {target} is what is read, which is never changed: name another file")


def _ranges(plan: Plan, rig: Rig) -> Mapping[str, RangeCase]:
    settings = plan.config.judge.range
    if settings is None:
        return {}
    names = [camera.name for camera in rig.cameras]
    return {pair.name: range_case(settings, plan.base, pair, names) for pair in rig.pairs}


def _fault(plan: Plan, index: int, cameras: Sequence[Camera], renderer: Renderer | None) -> Fault:
    chosen = plan.faults[index]
    settings = chosen.settings
    names = [camera.name for camera in cameras]
    problems = [
        _no_camera(("faults", index, key), name, names)
        for key in ("camera", "of", "partner")
        if (name := getattr(settings, key, None)) is not None and name not in names
    ]
    if problems:
        raise plan.document.error(problems)
    fault: Fault = chosen.build(settings, tuple(cameras), plan.config.seed, renderer)
    return fault


def _pair(entry: PairSettings) -> Pair:
    first, second = entry.pair.split("-")
    return Pair(first, second, round(entry.expected_offset_ms * NS_PER_MS))


def _no_camera(path: tuple[str | int, ...], name: str, names: Sequence[str]) -> Problem:
    return Problem(path, f"no camera '{name}': this rig has {', '.join(names)}")
