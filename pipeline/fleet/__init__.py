"""All rigs that are published over Zenoh, as one listener hears them."""
