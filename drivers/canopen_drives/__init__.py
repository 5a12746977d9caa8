"""Drives on a CAN bus (`canopen+socketcan://can0?bitrate=1000000&nodes=1,2,3,4,5,6`): docs/connecting-drives.md."""
