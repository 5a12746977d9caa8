"""Measuring methods: frames, tools and verdicts from measured points and contacts. Pure: arrays in, arrays out."""
