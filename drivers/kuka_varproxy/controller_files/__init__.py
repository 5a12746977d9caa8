"""Files to load on a KUKA controller for a cell with a variable proxy: the program, its data list, instructions."""
