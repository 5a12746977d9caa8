"""The points of the campaigns, for the console's 3-D scene and charts."""
