"""Which parameters the rows cannot determine, and for what reason."""
