"""Universal Robots controller (e-Series, CB3): state and commands by RTDE, Dashboard, a resident program."""
