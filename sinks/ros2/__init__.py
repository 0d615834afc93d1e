"""Diagnostics for ROS 2, without ROS."""
