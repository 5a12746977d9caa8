"""What stands in the simulated cell: the moving arm, and the contact between its tip and the spheres."""
