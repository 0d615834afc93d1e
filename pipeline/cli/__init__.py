"""The commands of syncwatch, one file a command or a few that belong together."""
