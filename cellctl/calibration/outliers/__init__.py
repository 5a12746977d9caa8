"""Which rows are outliers."""
