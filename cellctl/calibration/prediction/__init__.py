"""What an identified model predicts, how sure it is, and where it was never measured."""
