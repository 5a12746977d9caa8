"""The engine's side: the robot as campaigns know it, on the EthernetKRL channel and the RSI process."""
