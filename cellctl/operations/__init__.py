"""Operations on cells, runs and tables, for people and programs; returns values and raises, prints nothing."""
