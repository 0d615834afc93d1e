"""Luxonis OAK cameras, through depthai."""
