"""KUKA controller with a variable proxy (KUKAVARPROXY, C3 Bridge): variables, files, moves, tables."""
