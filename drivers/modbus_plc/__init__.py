"""The cell's PLC over Modbus TCP (`modbus+tcp://192.168.10.5:502?unit=1`): docs/connecting-a-plc.md has its I/O map."""
