"""The robot's model: its parameters, its postures, and its motion there."""
