"""A contact probe on a serial line (`contact+serial:///dev/ttyACM0?baud=250000`): docs/reference/probe-protocol.md."""
