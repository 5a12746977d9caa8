"""The robot's model: its parameters, postures and motion, and what an effect has to state."""
