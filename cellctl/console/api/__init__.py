"""The JSON API of the console: one router for each subject."""
