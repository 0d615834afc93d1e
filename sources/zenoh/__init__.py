"""Pictures that others publish over Zenoh."""
