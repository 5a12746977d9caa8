"""The operator's console: pages and a JSON API over the runs of one folder, in a process of its own."""
