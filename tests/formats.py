"""Writes one rendered scene in every recording format that is understood, through public libraries."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

from pipeline.frame import NS_PER_S, Frame
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource

EPOCH_NS = 1_700_000_000 * NS_PER_S
LATENCY_NS = 12_000_000
FPS = 20.0

Scene = Mapping[str, Sequence[Frame]]
Write = Callable[[Path, Scene], Path]


def rendered(seconds: float, width: int = 256, height: int = 192) -> SyntheticSource:
    settings = SyntheticSettings(speed="max", fps=FPS, width=width, height=height, duration_s=seconds)
    return SyntheticSource(settings, seed=3)


def scene_of(frames: Iterator[Frame]) -> Scene:
    """Frames by camera."""
    scene: dict[str, list[Frame]] = {}
    for frame in frames:
        scene.setdefault(frame.camera, []).append(frame)
    return scene


def stamp_ns(frame: Frame) -> int:
    return EPOCH_NS + frame.captured_ns


def in_order(scene: Scene) -> list[tuple[int, Frame]]:
    """Every frame with its camera's number, in the order in which a recorder would have had them."""
    return sorted(
        ((number, frame) for number, frames in enumerate(scene.values()) for frame in frames),
        key=lambda one: (one[1].captured_ns, one[0]),
    )


def _png(frame: Frame) -> bytes:
    return bytes(cv2.imencode(".png", frame.image)[1])


def write_png(path: Path, frame: Frame) -> None:
    path.write_bytes(_png(frame))


def _pictures(folder: Path, frames: Sequence[Frame], name: Callable[[int, Frame], str]) -> None:
    folder.mkdir(parents=True)
    for index, frame in enumerate(frames):
        (folder / f"{name(index, frame)}.png").write_bytes(_png(frame))


def euroc(root: Path, scene: Scene) -> Path:
    for number, frames in enumerate(scene.values()):
        camera = root / "mav0" / f"cam{number}"
        _pictures(camera / "data", frames, lambda _, frame: str(stamp_ns(frame)))
        rows = "".join(f"{stamp_ns(frame)},{stamp_ns(frame)}.png\r\n" for frame in frames)
        (camera / "data.csv").write_text("#timestamp [ns],filename\r\n" + rows)
    return root


def tumvi(root: Path, scene: Scene) -> Path:
    for number, frames in enumerate(scene.values()):
        camera = root / "dso" / f"cam{number}"
        _pictures(camera / "images", frames, lambda _, frame: str(stamp_ns(frame)))
        rows = (f"{stamp_ns(frame)} {stamp_ns(frame) / 1e9:.6f} 1.5\n" for frame in frames)
        (camera / "times.txt").write_text("# id timestamp exposure[ms]\n" + "".join(rows))
    return root


def _moment(ns: int) -> str:
    seconds, part = divmod(ns, NS_PER_S)
    return f"{np.datetime64(seconds, 's')}".replace("T", " ") + f".{part:09d}\n"


def kitti_raw(root: Path, scene: Scene) -> Path:
    for number, frames in enumerate(scene.values()):
        camera = root / f"image_{number:02d}"
        _pictures(camera / "data", frames, lambda index, _: f"{index:010d}")
        (camera / "timestamps.txt").write_text("".join(_moment(stamp_ns(frame)) for frame in frames))
    return root


def kitti_odometry(root: Path, scene: Scene) -> Path:
    for number, frames in enumerate(scene.values()):
        _pictures(root / f"image_{number}", frames, lambda index, _: f"{index:06d}")
    (root / "times.txt").write_text("".join(f"{index / FPS:e}\n" for index in range(len(next(iter(scene.values()))))))
    return root


def folders(root: Path, scene: Scene) -> Path:
    for name, frames in scene.items():
        _pictures(root / name, frames, lambda index, _: f"{name}{index}")  # noqa: B023 - used at once
    return root


def _video(path: Path, pictures: Sequence[Any], code: str = "FFV1") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), FPS, (width, height))
    assert writer.isOpened()
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()


def videos(root: Path, scene: Scene) -> Path:
    for name, frames in scene.items():
        _video(root / f"{name}.avi", [frame.image for frame in frames])
    return root


def side_by_side(root: Path, scene: Scene) -> Path:
    left, right = scene.values()
    _video(root / "both.avi", [np.hstack((a.image, b.image)) for a, b in zip(left, right, strict=True)])
    return root / "both.avi"


def top_bottom(root: Path, scene: Scene) -> Path:
    left, right = scene.values()
    _video(root / "both.avi", [np.vstack((a.image, b.image)) for a, b in zip(left, right, strict=True)])
    return root / "both.avi"


def _decimal(ns: int) -> str:
    return f"{ns // NS_PER_S}.{ns % NS_PER_S:09d}"


def caliscope(root: Path, scene: Scene) -> Path:
    rows = []
    for number, frames in enumerate(scene.values()):
        _video(root / f"cam_{number}.avi", [frame.image for frame in frames])
        rows += [f"{index},{number},{index},{_decimal(stamp_ns(frame))}" for index, frame in enumerate(frames)]
    (root / "timestamps.csv").write_text("\n".join(["sync_index,cam_id,frame_index,frame_time", *rows]) + "\n")
    return root


def img_frame_class() -> Any:
    """A message with the fields of depthai's ImgFrame that are read, as `dai.proto.img_frame.ImgFrame`."""
    file = descriptor_pb2.FileDescriptorProto(name="ImgFrame.proto", package="dai.proto.img_frame", syntax="proto3")
    time = file.message_type.add(name="Timestamp")
    time.field.add(name="sec", number=1, type=3, label=1)
    time.field.add(name="nsec", number=2, type=3, label=1)
    camera = file.message_type.add(name="CameraMetadata")
    camera.field.add(name="exposureTimeUs", number=1, type=13, label=1)
    frame = file.message_type.add(name="ImgFrame")
    kind = ".dai.proto.img_frame."
    frame.field.add(name="ts", number=1, type=11, label=1, type_name=f"{kind}Timestamp")
    frame.field.add(name="tsDevice", number=2, type=11, label=1, type_name=f"{kind}Timestamp")
    frame.field.add(name="sequenceNum", number=3, type=3, label=1)
    frame.field.add(name="cam", number=6, type=11, label=1, type_name=f"{kind}CameraMetadata")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("dai.proto.img_frame.ImgFrame"))


def depthai(root: Path, scene: Scene) -> Path:
    kind = img_frame_class()
    for name, frames in scene.items():
        _video(root / f"{name}.avi", [frame.image for frame in frames])
        with (root / f"{name}.mcap").open("wb") as file, ProtobufWriter(file) as writer:
            for index, frame in enumerate(frames):
                message = kind(sequenceNum=frame.sequence)
                message.tsDevice.sec, message.tsDevice.nsec = divmod(stamp_ns(frame), NS_PER_S)
                writer.write_message("video", message, EPOCH_NS + 77 * index, EPOCH_NS)
    return root


def _ros_image(store: Any, frame: Frame, **more: Any) -> Any:
    types = store.types
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns(frame), NS_PER_S))
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=frame.camera, **more)
    height, width = frame.image.shape
    data = np.ascontiguousarray(frame.image).reshape(-1)
    return types["sensor_msgs/msg/Image"](header, height, width, "mono8", 0, width, data)


def _ros_compressed(store: Any, frame: Frame) -> Any:
    raw = _ros_image(store, frame)
    data = np.frombuffer(_png(frame), np.uint8)
    return store.types["sensor_msgs/msg/CompressedImage"](raw.header, "png", data)


def rosbag1(root: Path, scene: Scene, fmt: Any = None, chunk_bytes: int = 1 << 20) -> Path:
    root.mkdir(parents=True)
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Bag1Writer(root / "drive.bag")
    writer.chunk_threshold = chunk_bytes
    if fmt is not None:
        writer.set_compression(fmt)
    with writer:
        topics = [
            writer.add_connection(f"/cam{number}/image_raw", "sensor_msgs/msg/Image", typestore=store)
            for number in range(len(scene))
        ]
        for number, frame in in_order(scene):
            data = store.serialize_ros1(_ros_image(store, frame, seq=frame.sequence), "sensor_msgs/msg/Image")
            writer.write(topics[number], stamp_ns(frame) + LATENCY_NS, data)
    return root / "drive.bag"


def rosbag1_lz4(root: Path, scene: Scene, chunk_bytes: int = 1 << 20) -> Path:
    return rosbag1(root, scene, Bag1Writer.CompressionFormat.LZ4, chunk_bytes)


def rosbag2(
    root: Path,
    scene: Scene,
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
    *,
    compressed: bool = False,
) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/CompressedImage" if compressed else "sensor_msgs/msg/Image"
    tail = "image_raw/compressed" if compressed else "image_raw"
    root.parent.mkdir(parents=True, exist_ok=True)
    writer = Bag2Writer(root, version=9, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = [writer.add_connection(f"/rig/{name}/{tail}", kind, typestore=store) for name in scene]
        for number, frame in in_order(scene):
            message = _ros_compressed(store, frame) if compressed else _ros_image(store, frame)
            writer.write(topics[number], stamp_ns(frame) + LATENCY_NS, store.serialize_cdr(message, kind))
    return root


def rosbag2_mcap(root: Path, scene: Scene) -> Path:
    return rosbag2(root, scene, StoragePlugin.MCAP)


def rosbag2_zstd_file(root: Path, scene: Scene) -> Path:
    return rosbag2(root, scene, mode=CompressionMode.FILE)


def rosbag2_zstd_message(root: Path, scene: Scene) -> Path:
    return rosbag2(root, scene, mode=CompressionMode.MESSAGE)


def rosbag2_compressed(root: Path, scene: Scene) -> Path:
    return rosbag2(root, scene, compressed=True)


def rosbag2_split(root: Path, scene: Scene) -> Path:
    """Two MCAP files of one recording and no metadata.yaml, as a recorder that was killed leaves them."""
    half = len(next(iter(scene.values()))) // 2
    parts = [{n: f[:half] for n, f in scene.items()}, {n: f[half:] for n, f in scene.items()}]
    root.mkdir(parents=True)
    for index, part in enumerate(parts):
        bag = rosbag2(root / f"part{index}", part, StoragePlugin.MCAP)
        next(bag.glob("*.mcap")).rename(root / f"drive_{index}.mcap")
        (bag / "metadata.yaml").unlink()
        bag.rmdir()
    return root


def foxglove_raw(root: Path, scene: Scene) -> Path:
    def message(frame: Frame) -> Any:
        height, width = frame.image.shape
        return RawImage(
            frame_id=frame.camera, width=width, height=height, encoding="mono8", step=width, data=frame.image.tobytes()
        )

    return _foxglove(root, scene, message)


def foxglove_compressed(root: Path, scene: Scene) -> Path:
    return _foxglove(root, scene, lambda frame: CompressedImage(frame_id=frame.camera, data=_png(frame), format="png"))


def foxglove_json(root: Path, scene: Scene) -> Path:
    root.mkdir(parents=True)
    with (root / "drive.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
        topics = [writer.register_channel(f"/{name}/image", "json", schema) for name in scene]
        for number, frame in in_order(scene):
            seconds, part = divmod(stamp_ns(frame), NS_PER_S)
            picture = base64.b64encode(_png(frame)).decode()
            fields = {"timestamp": {"sec": seconds, "nsec": part}, "frame_id": "", "data": picture, "format": "png"}
            logged_ns = stamp_ns(frame) + LATENCY_NS
            writer.add_message(topics[number], logged_ns, json.dumps(fields).encode(), logged_ns)
        writer.finish()
    return root / "drive.mcap"


def foxglove_video(root: Path, scene: Scene) -> Path:
    packets = {name: iter(_h264(frames)) for name, frames in scene.items()}
    return _foxglove(
        root, scene, lambda frame: CompressedVideo(frame_id="", data=next(packets[frame.camera]), format="h264")
    )


def _h264(frames: Sequence[Frame]) -> list[bytes]:
    """A packet a frame, parameter sets in every key frame, no B-frames: as Foxglove's schema wants it."""
    height, width = frames[0].image.shape
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = width, height, "yuv420p"
    context.time_base = Fraction(1, round(FPS))
    context.options = {"tune": "zerolatency", "crf": "10", "bf": "0", "g": "15", "preset": "ultrafast"}
    packets = []
    for index, frame in enumerate(frames):
        picture = av.VideoFrame.from_ndarray(frame.image, format="gray").reformat(format="yuv420p")
        picture.pts = index
        packets += [bytes(packet) for packet in context.encode(picture)]
    return packets + [bytes(packet) for packet in context.encode(None)]


def _foxglove(root: Path, scene: Scene, message: Callable[[Frame], Any]) -> Path:
    root.mkdir(parents=True)
    with (root / "drive.mcap").open("wb") as file, ProtobufWriter(file) as writer:
        for _, frame in in_order(scene):
            made = message(frame)
            made.timestamp.seconds, made.timestamp.nanos = divmod(stamp_ns(frame), NS_PER_S)
            logged_ns = stamp_ns(frame) + LATENCY_NS
            writer.write_message(f"/{frame.camera}/image", made, logged_ns, logged_ns)
    return root / "drive.mcap"


STAMPED: Mapping[str, Write] = {
    "euroc": euroc,
    "tumvi": tumvi,
    "kitti_raw": kitti_raw,
    "caliscope": caliscope,
    "depthai": depthai,
    "rosbag1": rosbag1,
    "rosbag1_lz4": rosbag1_lz4,
    "rosbag2": rosbag2,
    "rosbag2_mcap": rosbag2_mcap,
    "rosbag2_zstd_file": rosbag2_zstd_file,
    "rosbag2_zstd_message": rosbag2_zstd_message,
    "rosbag2_compressed": rosbag2_compressed,
    "rosbag2_split": rosbag2_split,
    "foxglove_raw": foxglove_raw,
    "foxglove_compressed": foxglove_compressed,
    "foxglove_json": foxglove_json,
    "foxglove_video": foxglove_video,
}
"""Formats that keep every frame's timestamp."""

UNSTAMPED: Mapping[str, Write] = {
    "folders": folders,
    "kitti_odometry": kitti_odometry,
    "videos": videos,
    "side_by_side": side_by_side,
    "top_bottom": top_bottom,
}
"""Formats that keep the order of frames only."""

LOSSY = {"foxglove_video"}
