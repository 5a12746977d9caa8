"""Long studies: `python -m tests.studies` lists them, `python -m tests.studies NAME` runs one."""
