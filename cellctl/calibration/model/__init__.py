"""The robot's model: what a fit may change, where the robot stood, and how it moves there."""
