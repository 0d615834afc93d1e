"""Recordings that hold messages by topic: ROS 1 bags, ROS 2 bags (db3, MCAP) and any other MCAP with pictures."""
