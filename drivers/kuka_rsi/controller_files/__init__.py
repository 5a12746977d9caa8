"""What a person loads on a KUKA controller for a cell: programs, channel and Ethernet configuration, instructions."""
