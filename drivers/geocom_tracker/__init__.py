"""Laser stations that speak GeoCOM on a serial line: TDRA, TDA, TM30, TS30, TPS1200."""
