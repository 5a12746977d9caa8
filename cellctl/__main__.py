import sys

if not sys.flags.safe_path:  # the working folder is the first place to import from: its `drivers`, `sims` are not ours
    del sys.path[0]

from cellctl.cli.main import main

main()
