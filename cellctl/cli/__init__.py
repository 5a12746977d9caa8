"""The command line: connects the packages, starts the simulators, shows progress and results."""
