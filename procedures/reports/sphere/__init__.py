"""Sections of the campaign that touches spheres: touches, stand-offs, reference touches, stops."""
