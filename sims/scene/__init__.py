"""What stands in the simulated cell: the world, the moving arm, and the contact between its tip and the spheres."""
