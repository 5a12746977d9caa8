"""Contents of the console's pages of specific kinds of campaigns (`procedures.campaigns`)."""
