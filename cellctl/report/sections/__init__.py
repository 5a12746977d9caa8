"""The sections that every run has: verdict, failures, identification, compensation table, provenance."""
