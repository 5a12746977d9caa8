"""Sections of the report of campaigns with a tracker."""
