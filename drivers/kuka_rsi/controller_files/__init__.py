"""Files to load on a KUKA controller for a cell: programs, channel and Ethernet configuration, instructions."""
