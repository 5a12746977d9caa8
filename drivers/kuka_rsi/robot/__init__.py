"""The engine's side: the robot for campaigns, through the EthernetKRL channel and the RSI process."""
