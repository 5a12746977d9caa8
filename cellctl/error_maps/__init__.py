"""Maps from joints, or places, to the error there, fitted to samples of it."""
