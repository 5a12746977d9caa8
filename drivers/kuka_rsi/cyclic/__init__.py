"""The RSI process: it answers the controller in every cycle. It imports nothing from the engine's side."""
