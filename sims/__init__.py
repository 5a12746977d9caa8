"""The simulated hardware of a cell: one world, and thin servers with the devices' own protocols."""
