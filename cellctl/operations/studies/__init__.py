"""Studies: thousands of fits or campaigns over factors and seeds, in processes here or on a Dask cluster.

`runner` computes units and appends their rows, `cluster` distributes them, `study_file` reads a study, `study` runs it.
"""
