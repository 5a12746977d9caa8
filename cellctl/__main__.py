from cellctl.cli.main import main

main()
