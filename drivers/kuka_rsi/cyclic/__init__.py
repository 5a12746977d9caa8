"""The RSI process: what answers the controller in every cycle. It imports nothing of the engine's side."""
