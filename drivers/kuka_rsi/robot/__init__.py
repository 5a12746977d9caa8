"""The engine's side: the robot as campaigns use it, on the EthernetKRL channel and the RSI process."""
