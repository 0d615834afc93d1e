"""A rendered rig: a scene, how it moves, and the cameras that watch it."""
