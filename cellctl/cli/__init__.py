"""The command line: composes the rooms, starts the simulators, shows what happens."""
