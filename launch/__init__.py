"""Who starts the nodes: graph and checks, launcher, scenes, command line, launch files."""
