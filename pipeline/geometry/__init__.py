"""The geometry of a rig over time: cameras that were knocked, that creep, or that were exchanged."""
