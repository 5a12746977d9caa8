"""Measuring with an instrument: frames, poses, checks of station and robot, performance figures. Pure: arrays only."""
