"""A web page with all rigs on the network."""
