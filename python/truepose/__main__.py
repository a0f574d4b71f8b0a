"""`python -m truepose`: the command line."""

from truepose.commands.cli import main

if __name__ == "__main__":
    main()
