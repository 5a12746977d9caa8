"""What people and programs do with cells, runs and tables; returns values and raises, prints nothing."""
