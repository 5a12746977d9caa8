"""Steps of the campaigns."""
