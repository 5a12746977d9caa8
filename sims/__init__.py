"""The cell's hardware in simulation: one world, and thin servers on the devices' own wires."""
