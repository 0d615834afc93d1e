"""Where and as whom a rig reports to ROS 2."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.zenoh_network import Endpoint
from sinks.zenoh_settings import PublishingSettings


class Ros2Settings(PublishingSettings):
    """By default a client of the router of this machine that rmw_zenoh's nodes use (ros2 run rmw_zenoh_cpp rmw_zenohd).

    domain_id: as ROS_DOMAIN_ID of the nodes that are to hear. node: the name this appears under in `ros2 node list`;
    left out, it is made of the rig's. humble: the nodes are of ROS 2 Humble, which knows no hashes of types.
    """

    type: Literal["ros2"] = "ros2"
    mode: Literal["peer", "client", "router"] = "client"
    connect: tuple[Endpoint, ...] = ("tcp/127.0.0.1:7447",)
    domain_id: int = Field(default=0, ge=0, le=232)
    node: Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=255)] | None = None
    humble: bool = False
