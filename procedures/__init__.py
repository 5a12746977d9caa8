"""Campaigns, their steps, cells and robots."""
